"""Force elements over a motion: strains, forces on both places, stiffness and damping in the reference state."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fmd.core.arrays import Array
from fmd.dynamics.closures import GROUND, fixed_place
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiler.compiled import compile_mechanism
from fmd.dynamics.elements import Attachment, PointSpring, SixAxisSpring
from fmd.dynamics.force_laws import ForceCurve, ForceLaw
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.linear_forces import gather_linear_forces, linearise_forces
from tests.dynamics.compiler.comparison import TIME
from tests.dynamics.compiler.random_elements import strain as strain_of
from tests.dynamics.compiler.random_elements import with_elements


@pytest.mark.parametrize("seed", range(6))
def test_strains_are_those_of_places_by_matrix_products(seed: int) -> None:
    made, _ = with_elements(seed, second_order=seed % 2 == 0)
    q, v = made.state(seed)
    motion = Kinematics(made.mechanism, np.array([TIME]), q[None], v[None])
    for element in made.mechanism.elements:
        (found,), expected = motion.strain(element)[0], strain_of(made, element, TIME, q)
        assert found == pytest.approx(expected[: len(found)], rel=1e-9, abs=1e-12)
        assert len(found) == len(expected) or not element.twists


@pytest.mark.parametrize("seed", range(6))
def test_the_forces_on_both_places_do_the_work_of_the_strain(seed: int) -> None:
    made, _ = with_elements(seed, second_order=True)
    q, v = made.state(seed)
    motion = Kinematics(made.mechanism, np.array([TIME]), q[None], v[None])
    for element in made.mechanism.elements:
        (values, rates, _), (wrenches,) = motion.strain(element), motion.wrenches(element)
        places = [motion.place_motion(end) for end in element.ends]
        velocities = np.array([np.r_[place.velocity[0], place.spin[0]] for place in places])
        if isinstance(element, PointSpring):
            sizes = element.law.forces(values[:, 0], rates[:, 0])[:, None]
        else:
            some = slice(values.shape[1])
            sizes = values @ element.K[some, some] + rates @ element.C[some, some]
        assert (wrenches * velocities).sum() == pytest.approx(-float((sizes * rates).sum()), rel=1e-9)
        assert wrenches[:, :3].sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)


@pytest.mark.parametrize("seed", [0, 2])
def test_stiffness_and_damping_are_the_tangents_of_the_unstrained_mechanism(seed: int) -> None:
    made, _ = with_elements(seed)
    links = [
        replace(link, motion=None, rest=0.0, joint_displacement2=np.zeros((0, 0))) for link in made.mechanism.links
    ]
    mechanism = replace(made.mechanism, links=links, loads=(), gravity=np.zeros(3), fast_joints=(), slow_modes={})
    rest = mechanism.rest_positions
    motion = Kinematics(mechanism, np.zeros(1), rest[None], np.zeros((1, mechanism.n)))
    elements = [_unstrained(element, motion.strain(element)[0][0]) for element in mechanism.elements]
    mechanism = replace(mechanism, elements=elements)
    compiled, none = compile_mechanism(mechanism), np.zeros(mechanism.n)
    by_q, by_v, _ = compiled.tangents(compiled.signal_values(0.0), rest, none, none)
    bare = compile_mechanism(replace(mechanism, elements=()))
    by_q0, by_v0, _ = bare.tangents(bare.signal_values(0.0), rest, none, none)
    forces, own = linearise_forces(mechanism), gather_linear_forces(mechanism.links, mechanism.layout)
    assert pytest.approx(by_v - by_v0, abs=1e-9) == forces.C - own.C
    if mechanism.n == mechanism.n_positions:  # a quaternion's entries aren't its rates
        assert pytest.approx(by_q - by_q0, abs=1e-8) == forces.K - own.K
    assert np.linalg.eigvalsh(forces.stop_K)[0] > -1e-9
    system = CompiledSystem(mechanism)
    assert system.largest_step < 2.0 / system.highest_frequency  # dampers and stops take their part


@pytest.mark.parametrize("length", [0.5, 0.8])
def test_a_spring_in_tension_is_stiff_across_its_line_and_one_in_compression_is_not_soft(length: float) -> None:
    """The second derivatives of ``½ k (|x| − L)²``, those across the line only where they are positive."""
    k, along = 300.0, np.array([[0.6, 0.0, 0.8]])
    ends = tuple(Attachment(GROUND, fixed_place(x).marker) for x in (np.zeros(3), length * along[0]))
    spring = PointSpring("spring", ends, ForceLaw(ForceCurve((0.0, k))), rest=0.6)
    K, *_ = spring.linearise(along, np.eye(3), np.array([length - spring.rest]))
    across = max(0.0, k * (length - spring.rest) / length)
    assert pytest.approx(k * along.T @ along + across * (np.eye(3) - along.T @ along), abs=1e-9) == K


def _unstrained(element: PointSpring | SixAxisSpring, values: Array) -> PointSpring | SixAxisSpring:
    if isinstance(element, PointSpring):
        law = replace(element.law, curve=element.law.curve if element.name == "linear" else LINEAR)
        stops = tuple(replace(stop, at=stop.side * 5.0) for stop in law.stops)
        return replace(element, rest=float(values[0] + element.rest), law=replace(law, stops=stops))
    first, second = element.ends
    turn = Rotation.from_rotvec(values[3:] if element.twists else np.zeros(3)).as_matrix()
    straight = replace(second, axes=second.axes @ turn.T)
    return replace(element, position=element.position + values[:3], ends=(first, straight))


LINEAR = with_elements(0)[0].mechanism.elements[0].law.curve
