"""Force elements over a motion: energies, forces on both places, stiffness and damping in the reference state."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fmd.core.rotations import rotation_vector
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiler.compiled import compile_mechanism
from fmd.dynamics.element_linearisation import linearise_forces
from fmd.dynamics.element_motion import element_strain, element_wrenches, place_motion
from fmd.dynamics.elements import PointSpring, SixAxisSpring
from fmd.dynamics.kinematics import Kinematics
from tests.dynamics.compiler.comparison import TIME, interpreted
from tests.dynamics.compiler.random_elements import strain as strain_of
from tests.dynamics.compiler.random_elements import with_elements


@pytest.mark.parametrize("seed", range(6))
def test_energies_and_strains_are_those_of_the_compiled_functions(seed: int) -> None:
    made, _ = with_elements(seed, second_order=seed % 2 == 0)
    q, v = made.state(seed)
    motion = Kinematics(made.mechanism, np.array([TIME]), q[None], v[None])
    found = interpreted(compile_mechanism(made.mechanism), "energies", (2,), q=q, v=v)
    assert np.concatenate(motion.energies) == pytest.approx(found, rel=1e-9)
    for element in made.mechanism.elements:
        assert element_strain(motion.states, element).values[0] == pytest.approx(
            strain_of(made, element, TIME, q), rel=1e-9, abs=1e-12
        )


@pytest.mark.parametrize("seed", range(6))
def test_the_forces_on_both_places_do_the_work_of_the_strain(seed: int) -> None:
    made, _ = with_elements(seed, second_order=True)
    q, v = made.state(seed)
    states = Kinematics(made.mechanism, np.array([TIME]), q[None], v[None]).states
    for element in made.mechanism.elements:
        strain, power = element_strain(states, element), 0.0
        for end, (force, moment) in zip(element.ends, element_wrenches(states, element), strict=True):
            place = place_motion(states, end)
            power += float((force * place.velocity + moment * place.spin).sum())
        if isinstance(element, PointSpring):
            sizes = element.law.forces(strain.values[:, 0], strain.rates[:, 0])[:, None]
        else:
            sizes = strain.values @ element.K + strain.rates @ element.C
        assert power == pytest.approx(-float((sizes * strain.rates).sum()), rel=1e-9)
        total = sum(force for force, _ in element_wrenches(states, element))
        assert total == pytest.approx(np.zeros((1, 3)), abs=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_stiffness_and_damping_are_the_tangents_of_the_unstrained_mechanism(seed: int) -> None:
    made, _ = with_elements(seed)
    links = [replace(link, motion=None, rest=0.0, joint_bow=np.zeros((0, 0))) for link in made.mechanism.links]
    mechanism = replace(made.mechanism, links=links, loads=(), gravity=np.zeros(3), fast_joints=(), slow_modes={})
    rest = mechanism.rest_positions
    states = Kinematics(mechanism, np.zeros(1), rest[None], np.zeros((1, mechanism.n))).states
    elements = [_unstrained(element, states) for element in mechanism.elements]
    mechanism = replace(mechanism, elements=elements)
    compiled, none = compile_mechanism(mechanism), np.zeros(mechanism.n)
    by_q, by_v, _ = compiled.tangents(compiled.signal_values(0.0), rest, none, none)
    bare = compile_mechanism(replace(mechanism, elements=()))
    by_q0, by_v0, _ = bare.tangents(bare.signal_values(0.0), rest, none, none)
    forces, own = linearise_forces(mechanism), mechanism.linear_forces
    assert pytest.approx(by_v - by_v0, abs=1e-9) == forces.C - own.C
    if mechanism.n == mechanism.n_positions:  # a quaternion's entries aren't its rates
        assert pytest.approx(by_q - by_q0, abs=1e-8) == forces.K - own.K
    assert np.linalg.eigvalsh(forces.stop_K)[0] > -1e-9
    system = CompiledSystem(mechanism)
    assert system.largest_step < 2.0 / system.highest_frequency  # dampers and stops take their part


def _unstrained(element: PointSpring | SixAxisSpring, states):
    values = element_strain(states, element).values[0]
    if isinstance(element, PointSpring):
        law = replace(element.law, curve=element.law.curve if element.name == "linear" else LINEAR)
        stops = tuple(replace(stop, at=stop.side * 5.0) for stop in law.stops)
        return replace(element, rest=float(values[0] + element.rest), law=replace(law, stops=stops))
    first, second = element.ends
    turn = Rotation.from_rotvec(values[3:]).as_matrix()
    straight = replace(second, axes=second.axes @ turn.T)
    return replace(element, position=element.position + values[:3], ends=(first, straight))


LINEAR = with_elements(0)[0].mechanism.elements[0].law.curve


def test_rotation_vectors_are_those_of_scipy_up_to_half_a_turn() -> None:
    rng = np.random.default_rng(2)
    vectors = rng.normal(size=(50, 3))
    vectors *= (rng.uniform(0.0, np.pi, 50) / np.linalg.norm(vectors, axis=1))[:, None]
    vectors[0] = 0.0
    assert rotation_vector(Rotation.from_rotvec(vectors).as_matrix()) == pytest.approx(vectors, abs=1e-12)
