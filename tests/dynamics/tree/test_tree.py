"""An open chain against mass points: inertia, accelerations, conservation, steps, sub-cycling, raises."""

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from pipeline.core.arrays import Array
from pipeline.dynamics.kinematics import Kinematics
from pipeline.dynamics.links import FIXED, FREE, PRISMATIC, REVOLUTE, SPHERICAL, Link, rigid_gram
from pipeline.dynamics.mechanism import Mechanism
from pipeline.dynamics.signals.signal import constant
from pipeline.integrators.central_difference import CentralDifference
from pipeline.integrators.protocol import State, evaluate, evaluate_velocities
from pipeline.integrators.scipy_ivp import ScipyIvp
from pipeline.integrators.subcycling import Subcycling

Make = Callable[..., Any]

SEEDS = range(4)
WEIGHT = (1.0, -2.0, -9.81)  # aslant, so that no axis of the ground is special
TURN = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
SHIFT = np.array([3.0, -2.0, 1.0])
CLOSELY = ScipyIvp("DOP853", 1e-11)
METHODS = pytest.mark.parametrize("method", [CentralDifference(1e-3), Subcycling(1e-3, 5)], ids=["plain", "5:1"])
SECTIONS = pytest.mark.parametrize("section", [0.0, 1.0], ids=["stiff-sections", "turning-sections"])


def with_sections(chain: Any, scale: float) -> Any:
    """Scale how far the sections at revolute joints turn with the modes."""
    links = [replace(link, joint_rotation=scale * link.joint_rotation) for link in chain.tree.links]
    return replace(chain, tree=replace(chain.tree, links=links))


def compiled(tree: Mechanism, q: Array, v: Array) -> Array:
    a = np.full(tree.n, np.nan)
    evaluate(tree.parameters, 0.0, q, v, a)
    return a


def by_points(chain: Any, q: Array, v: Array) -> Array:
    """Solve d'Alembert's principle, Σ m Jᵀ (J a + bias − g) = Q over all points (Kane & Levinson, Dynamics, 1985)."""
    J = chain.jacobian(q)
    M = np.einsum("i,iaj,iak->jk", chain.masses, J, J)
    lack = chain.tree.gravity - chain.bias(q, v)
    return np.asarray(np.linalg.solve(M, np.einsum("i,iaj,ia->j", chain.masses, J, lack) + chain.loads(q, v)))


def total_energy(chain: Any, march: Any) -> Array:
    """Energy from the points."""
    return np.array([chain.kinetic(q, v) + chain.potential(q) for q, v in zip(march.q, march.v, strict=True)])


# Equations of motion ---------------------------------------------------------------------------------------------


def test_the_mass_matrix_is_that_of_the_points(chain: Make, name: str) -> None:
    # T = ½ Σ m |J v|², so its Hessian by the rates is Σ m JᵀJ.
    some = chain(name)
    for seed in SEEDS:
        q, _ = some.state(seed)
        J = some.jacobian(q)
        want = np.einsum("i,iaj,iak->jk", some.masses, J, J)
        M = some.tree.mass_matrix(q)
        assert pytest.approx(want, abs=1e-12 * np.abs(want).max()) == M
        assert np.array_equal(M, M.T)
        assert np.linalg.eigvalsh(M)[0] > 0


def test_accelerations_follow_from_dalemberts_principle_on_the_points(chain: Make, name: str) -> None:
    # Springs, dampers, loads, weight, modal damping and sections that turn with the modes, all at once.
    some = chain(name, gravity=WEIGHT)
    for seed in SEEDS:
        q, v = some.state(seed)
        want = by_points(some, q, v)
        assert compiled(some.tree, q, v) == pytest.approx(want, abs=1e-11 * np.abs(want).max())


@pytest.mark.parametrize("size", [0.0, *10.0 ** np.arange(-6.0, 0.1, 0.5)], ids=lambda size: f"{size:.0e}")
def test_a_place_turned_by_the_modes_is_right_at_angles_of_any_size(chain: Make, size: float) -> None:
    some = chain("free-flexible")
    link = some.tree.links[1]
    q, v = some.state(0, 1.0)
    (first, *_, last), inner = some.positions_of(np.arange(len(q)))[1], np.array([1.0, 0.7])
    q[first[0] : last[-1] + 1] = 0.0
    q[first] = size * inner / np.linalg.norm(link.place_rotations @ inner)
    want = by_points(some, q, v)
    assert compiled(some.tree, q, v) == pytest.approx(want, abs=1e-12 * np.abs(want).max())


def test_shapes_that_are_left_out_count_as_zero(chain: Make, name: str) -> None:
    whole = chain(name, gravity=WEIGHT)
    links = [
        replace(
            link,
            damping=0 * link.damping,
            joint_rotation=0 * link.joint_rotation,
            place_shapes=0 * link.place_shapes,
            place_rotations=0 * link.place_rotations,
        )
        for link in whole.tree.links
    ]
    none = np.zeros((3, 0))
    bare = whole.with_links(
        damping=np.zeros(0), joint_rotation=np.zeros(0), place_shapes=none, place_rotations=none
    ).tree
    zeros = replace(whole.tree, links=links)
    q, v = whole.state(17)
    assert np.array_equal(compiled(bare, q, v), compiled(zeros, q, v))
    energies = [Kinematics(tree, np.zeros(1), q[None], v[None]).energies for tree in (bare, zeros)]
    assert np.array_equal(*energies)
    assert bare.highest_frequency == zeros.highest_frequency


def test_positions_change_at_the_rates(chain: Make, name: str) -> None:
    some = chain(name)
    q, v = some.state(6)
    found = np.full(len(q), np.nan)
    evaluate_velocities(some.tree.parameters, q, v, found)
    assert found == pytest.approx(some.derivative(q, v), abs=1e-15)


def test_the_undeformed_chain_has_all_frames_parallel_to_the_ground(chain: Make, name: str) -> None:
    tree = chain(name).tree
    places: dict[int, Array] = {-1: np.zeros(3)}
    frames = Kinematics(tree, np.zeros(1), tree.rest_positions[None], np.zeros((1, tree.n))).frames
    for k, link in enumerate(tree.links):
        places[k] = places[link.parent] + link.place
        assert frames[k].origin[0] == pytest.approx(places[k], abs=1e-15)
        assert np.array_equal(frames[k].rotation[0], np.eye(3))


def test_slow_joints_come_first_then_fast_ones_then_modes(chain: Make) -> None:
    tree = chain("free-flexible").tree
    assert list(tree.fast_joints) == ["body 3"]
    # 6 free, 1 revolute, 3 spherical and 1 revolute are slow; 1 prismatic and 10 modes fast; 2 rotations in space.
    assert (tree.n_slow, tree.n, tree.n_positions) == (11, 22, 24)
    rate, position = tree.layout.rate, tree.layout.position
    assert rate.tolist() == [0, 6, 7, 11, 10, 11]
    assert position.tolist() == [0, 7, 8, 13, 12, 13]
    assert [tree.modes_of(k).tolist()[:1] for k in range(6)] == [[12], [14], [], [17], [19], [21]]
    assert np.flatnonzero(tree.rest_positions).tolist() == [6, 11]  # scalar parts of the quaternions


def test_each_caller_of_parameters_has_room_of_its_own(chain: Make) -> None:
    some = chain("free-flexible")
    one, other = some.tree.parameters, some.tree.parameters
    q, v = some.state(7)
    evaluate(one, 0.0, q, v, np.zeros(some.tree.n))
    for field in ("origin", "R", "spin", "bias", "J", "R0", "M", "L", "Q", "small", "modal"):
        assert not getattr(other, field).any()


@SECTIONS
def test_the_frequencies_that_limit_the_step_are_those_of_small_motions(chain: Make, name: str, section: float) -> None:
    # Undeformed, with all frames parallel to the ground: K x = ω² M x with the inertia of the points.
    some = with_sections(chain(name), section)
    q = np.zeros(some.tree.n_positions)
    for place in some.positions_of(np.arange(q.size))[0]:
        q[place[-1:]] = float(place.size >= 4)
    J = some.jacobian(q)
    M, K, first = np.einsum("i,iaj,iak->jk", some.masses, J, J), some.stiffness(), some.tree.n_slow
    assert some.tree.highest_frequency == pytest.approx(np.sqrt(eigh(K, M)[0][-1]), rel=1e-9)
    if first < some.tree.n:
        fast = np.sqrt(eigh(K[first:, first:], M[first:, first:])[0][-1])
        assert some.tree.highest_fast_frequency == pytest.approx(fast, rel=1e-9)


# Motion ----------------------------------------------------------------------------------------------------------


def test_energy_is_conserved(chain: Make, name: str) -> None:
    some = chain(name, gravity=WEIGHT).with_links(load=constant(0.0), damper=0.0, damping=np.zeros(0))
    march = CLOSELY.march(some.tree, *some.state(0), np.linspace(0.0, 2.0, 21))
    energy = total_energy(some, march)
    scale = max(some.kinetic(q, v) for q, v in zip(march.q, march.v, strict=True))
    assert energy == pytest.approx(np.full(21, energy[0]), abs=1e-10 * scale)


def test_momentum_is_conserved_whatever_acts_within(chain: Make, free_name: str) -> None:
    # Springs, loads and dampers act between two bodies of the chain.
    some = chain(free_name)
    march = CLOSELY.march(some.tree, *some.state(1), np.linspace(0.0, 2.0, 11))
    p, L = zip(*(some.momenta(q, v) for q, v in zip(march.q, march.v, strict=True)), strict=True)
    assert np.array(p) == pytest.approx(np.tile(p[0], (11, 1)), abs=1e-10 * np.linalg.norm(p[0]))
    assert np.array(L) == pytest.approx(np.tile(L[0], (11, 1)), abs=1e-10 * np.linalg.norm(L[0]))


def test_a_chain_that_nothing_holds_falls_as_its_centre_of_mass(chain: Make, free_name: str) -> None:
    # Newton: the momentum grows by m g t, whatever the bodies do to each other.
    some = chain(free_name, gravity=WEIGHT)
    times = np.linspace(0.0, 1.0, 6)
    march = CLOSELY.march(some.tree, *some.state(2), times)
    p = np.array([some.momenta(q, v)[0] for q, v in zip(march.q, march.v, strict=True)])
    want = p[0] + some.masses.sum() * np.outer(times, WEIGHT)
    assert p == pytest.approx(want, abs=1e-9 * np.abs(want).max())


def test_loads_along_joints_do_the_work_that_the_chain_gains(chain: Make, name: str) -> None:
    some = chain(name, gravity=WEIGHT).with_links(damper=0.0, damping=np.zeros(0))
    march = CLOSELY.march(some.tree, *some.state(3), np.linspace(0.0, 2.0, 21))
    work = []
    for q in march.q:
        joints, modes = some.positions_of(q)
        along = [
            link.load.value(0.0)[0] * (s[0] + (link.joint_rotation @ inner if link.joint_rotation.size else 0.0))
            for link, s, inner in zip(some.tree.links, joints, modes, strict=True)
            if link.joint in (REVOLUTE, PRISMATIC)
        ]
        work.append(sum(along))
    energy, gained = total_energy(some, march), np.array(work) - work[0]
    assert np.ptp(gained) > 0.1
    assert energy - energy[0] == pytest.approx(gained, abs=1e-9 * np.abs(energy).max())


def test_dampers_take_out_what_their_rates_cost_and_never_add(chain: Make, name: str) -> None:
    # A viscous joint takes c ṡ² and a mode 2 ζ ω q̇², where ṡ is the rate at which the section at the joint turns.
    some = chain(name, gravity=WEIGHT).with_links(load=constant(0.0))
    times = np.linspace(0.0, 2.0, 2001)
    march = CLOSELY.march(some.tree, *some.state(4), times)
    energy = np.sum(Kinematics(some.tree, march.times, march.q, march.v).energies, axis=0)
    power = np.zeros(times.size)
    for i, v in enumerate(march.v):
        for link, ds, d_inner in zip(some.tree.links, *some.rates_of(v), strict=True):
            power[i] += 2 * (link.damping * link.omega) @ d_inner**2
            if link.damper:
                section = link.joint_rotation @ d_inner if link.joint_rotation.size else 0.0
                power[i] += link.damper * (ds[0] + section) ** 2
    scale = np.abs(energy).max()
    assert np.diff(energy).max() < 1e-12 * scale
    lost = np.array([simpson(power[: k + 1], x=times[: k + 1]) for k in range(0, times.size, 200)])
    assert lost[-1] > 0.1
    assert energy[0] - energy[::200] == pytest.approx(lost, abs=1e-8 * scale)


def test_describing_everything_in_turned_axes_changes_nothing(chain: Make, name: str) -> None:
    some = chain(name, gravity=WEIGHT)
    turned, times = some.turned(TURN, SHIFT), np.linspace(0.0, 1.0, 6)
    start = some.state(8)
    here = CLOSELY.march(some.tree, *start, times)
    there = CLOSELY.march(turned.tree, *some.turned_state(TURN, *start), times)
    for k in range(times.size):
        q, v = some.turned_state(TURN, here.q[k], here.v[k])
        assert there.q[k] == pytest.approx(q, abs=1e-9)
        assert there.v[k] == pytest.approx(v, abs=1e-9 * np.abs(v).max())
        assert turned.points(there.q[k]) == pytest.approx(some.points(here.q[k]) @ TURN.T + SHIFT, abs=1e-9)


@METHODS
def test_a_free_chain_moves_alike_from_a_turned_and_moved_start(
    chain: Make, free_name: str, method: CentralDifference | Subcycling
) -> None:
    # Only the pose and the velocity of the free body are told in the ground's axes.
    some = chain(free_name, gravity=WEIGHT)
    turned = replace(some, tree=replace(some.tree, gravity=TURN @ some.tree.gravity))
    q, v = some.state(9)
    other_q, other_v = q.copy(), v.copy()
    place = some.tree.links[0].place
    other_q[:3] = TURN @ (place + q[:3]) + SHIFT - place
    other_q[3:7] = (Rotation.from_matrix(TURN) * Rotation.from_quat(q[3:7])).as_quat()
    other_v[:3] = TURN @ v[:3]
    times = np.linspace(0.0, 1.0, 6)
    here, there = method.march(some.tree, q, v, times), method.march(turned.tree, other_q, other_v, times)
    assert there.q[:, 7:] == pytest.approx(here.q[:, 7:], abs=1e-11)
    for k in range(times.size):
        assert turned.points(there.q[k]) == pytest.approx(some.points(here.q[k]) @ TURN.T + SHIFT, abs=1e-10)


# Steps -----------------------------------------------------------------------------------------------------------


def order_of(march: Callable[[float], Any], want: Any, steps: Array) -> tuple[float, float]:
    """Measured orders of positions and rates."""
    errors = [(np.abs(found.q - want.q).max(), np.abs(found.v - want.v).max()) for found in map(march, steps)]
    fit = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    return float(fit[0]), float(fit[1])


def test_central_difference_is_of_second_order_on_any_chain(chain: Make, name: str) -> None:
    some = chain(name, gravity=WEIGHT)
    start, times, steps = some.state(10), np.linspace(0.0, 1.0, 11), 0.004 / 2.0 ** np.arange(4)
    want = CLOSELY.march(some.tree, *start, times)
    found = order_of(lambda step: CentralDifference(step).march(some.tree, *start, times), want, steps)
    assert found == pytest.approx((2, 2), abs=0.1)


def test_central_difference_is_of_second_order_between_its_steps(chain: Make) -> None:
    some = chain("free-flexible", gravity=WEIGHT)
    start, steps = some.state(10), 0.004 / 2.0 ** np.arange(4)
    times = np.sort(np.random.default_rng(0).uniform(0.0, 1.0, 300))
    want = CLOSELY.march(some.tree, *start, times)
    found = order_of(lambda step: CentralDifference(step).march(some.tree, *start, times), want, steps)
    assert found == pytest.approx((2, 2), abs=0.1)


@pytest.mark.parametrize("m", [2, 5])
def test_sub_cycling_is_at_least_of_first_order_on_any_chain(chain: Make, name: str, m: int) -> None:
    # Whatever is held over a cycle is late by half of it.
    some = chain(name, gravity=WEIGHT)
    start, times, steps = some.state(10), np.linspace(0.0, 1.0, 11), 0.002 / 2.0 ** np.arange(4)
    want = CLOSELY.march(some.tree, *start, times)
    found = order_of(lambda step: Subcycling(step, m).march(some.tree, *start, times), want, steps)
    assert Subcycling(1.0, m).order(some.tree) == 1
    assert min(found) > 0.9


def by_the_paper(chain: Any, h: float, m: int, n_cycles: int, q: Array, v: Array) -> Array:
    """Sub-cycle by eqs. (8)–(11) of Miao et al. (2008), positions at the start of each cycle.

    M̂, the slow accelerations and all forces are held over a cycle, but for K_S q_S; the paper has no dampers.
    """
    tree, first, H = chain.tree, chain.tree.n_slow, m * h
    # Both sets keep their rates half a step behind.
    step = np.r_[np.full(first, H), np.full(tree.n - first, h)]
    at = len(q) - tree.n + np.arange(first, tree.n)  # positions of the fast coordinates
    K = chain.stiffness()[first:, first:]
    a = compiled(tree, q, v)
    v = v - 0.5 * step * a
    found = []
    for _ in range(n_cycles):
        found.append(q)
        a = compiled(tree, q, v + 0.5 * step * a)
        M = tree.mass_matrix(q)
        held = (M @ a)[first:] + K @ q[at] - M[first:, :first] @ a[:first]
        v = v + np.r_[H * a[:first], h * a[first:]]
        q = chain.moved(q, np.r_[v[:first], np.zeros(at.size)], H)
        q[at] += h * v[first:]
        for _ in range(m - 1):
            a[first:] = np.linalg.solve(M[first:, first:], held - K @ q[at])
            v[first:] += h * a[first:]
            q[at] += h * v[first:]
    return np.array(found)


@pytest.mark.parametrize("m", [2, 5])
@SECTIONS
def test_sub_cycling_follows_the_papers_equations(chain: Make, name: str, section: float, m: int) -> None:
    some = with_sections(chain(name, gravity=WEIGHT), section).with_links(damper=0.0, damping=np.zeros(0))
    start, h = some.state(11), 0.01
    want = by_the_paper(some, h, m, 20, *start)
    march = Subcycling(h, m).march(some.tree, *start, m * h * np.arange(20))
    assert march.q == pytest.approx(want, abs=1e-10)


@pytest.mark.parametrize("m", [2, 5, 10])
@pytest.mark.parametrize("joint", [FIXED, PRISMATIC, REVOLUTE])
def test_a_body_with_no_slow_joint_is_sub_cycled_as_by_central_difference(chain: Make, joint: int, m: int) -> None:
    # Where nothing is slow all steps are fast steps. The body's equations are linear, with dampers: on a fixed or
    # prismatic joint without weight by themselves, and on a revolute one near rest (turned by 1e-8 rad).
    link = replace(chain("revolute-flexible").tree.links[0], joint=joint, load=constant(0.0), rest=0.0)
    if joint != REVOLUTE:
        link = replace(link, joint_rotation=np.zeros(0))
    if joint == FIXED:
        link = replace(link, spring=0.0, damper=0.0)
    tree = Mechanism([link], [link.name] if joint != FIXED else [])
    assert tree.n_slow == 0
    q0, times = 1e-8 * np.random.default_rng(0).normal(size=tree.n), np.linspace(0.0, 10.0, 101)
    plain = CentralDifference(0.04).march(tree, q0, np.zeros(tree.n), times)
    sub_cycled = Subcycling(0.04, m).march(tree, q0, np.zeros(tree.n), times)
    assert sub_cycled.q == pytest.approx(plain.q, abs=1e-14)
    assert np.abs(plain.q[-1]).max() < 0.7 * np.abs(q0).max()  # the dampers show


def assert_same_state(one: State, other: State) -> None:
    assert one.step == other.step
    for field in "qva":
        assert np.array_equal(getattr(one, field), getattr(other, field))


def test_one_to_one_sub_cycling_is_central_difference_bit_for_bit(chain: Make, name: str) -> None:
    some = chain(name, gravity=WEIGHT)
    start, times = some.state(12), np.linspace(0.0, 2.0, 77)
    plain, one = (method.march(some.tree, *start, times) for method in (CentralDifference(0.002), Subcycling(0.002, 1)))
    assert np.array_equal(plain.q, one.q)
    assert np.array_equal(plain.v, one.v)
    assert_same_state(plain.end, one.end)
    assert Subcycling(1.0, 1).order(some.tree) == CentralDifference(1.0).order(some.tree) == 2


@METHODS
def test_a_march_goes_on_from_its_end_bit_for_bit(chain: Make, name: str, method: CentralDifference) -> None:
    some = chain(name, gravity=WEIGHT)
    start, times = some.state(13), np.linspace(0.0, 1.0, 41)
    whole = method.march(some.tree, *start, times)
    part = method.march(some.tree, *start, times[:17])
    rest = method.resume(some.tree, part.end, times)
    later = times > part.end.step * method.step
    assert later.sum() >= 20
    assert np.array_equal(rest.q[later], whole.q[later])
    assert np.array_equal(rest.v[later], whole.v[later])
    assert_same_state(rest.end, whole.end)


@METHODS
def test_output_times_never_change_the_steps(chain: Make, name: str, method: CentralDifference) -> None:
    some = chain(name, gravity=WEIGHT)
    start = some.state(14)
    few = np.array([0.0, 0.5, 1.0])
    many = np.union1d(few, np.random.default_rng(0).uniform(0.0, 1.0, 400))
    seldom, often = method.march(some.tree, *start, few), method.march(some.tree, *start, many)
    assert np.array_equal(seldom.q, often.q[np.isin(many, few)])
    assert np.array_equal(seldom.v, often.v[np.isin(many, few)])
    assert_same_state(seldom.end, often.end)


@METHODS
def test_two_marches_at_once_would_not_share_room(chain: Make, method: CentralDifference) -> None:
    # The same march before and after another one on the same mechanism.
    some = chain("free-flexible", gravity=WEIGHT)
    times = np.linspace(0.0, 0.5, 6)
    before = method.march(some.tree, *some.state(15), times)
    method.march(some.tree, *some.state(16), times)
    after = method.march(some.tree, *some.state(15), times)
    assert np.array_equal(before.q, after.q)


# Raises ----------------------------------------------------------------------------------------------------------

POINT = rigid_gram(1.0, np.zeros(3), np.eye(3))


@pytest.mark.parametrize("parent", [-2, 1, 2])
def test_a_link_comes_after_its_parent(parent: int) -> None:
    links = [Link("first", POINT, FREE), Link("second", POINT, REVOLUTE, parent)]
    with pytest.raises(ValueError, match=re.escape("link second comes before its parent")):
        Mechanism(links)


def test_a_link_does_not_carry_itself() -> None:
    with pytest.raises(ValueError, match=re.escape("link first comes before its parent")):
        Mechanism([Link("first", POINT, FREE, parent=0)])


@pytest.mark.parametrize("joint", [FIXED, SPHERICAL, FREE])
def test_only_a_joint_of_one_coordinate_can_be_fast(joint: int) -> None:
    message = "the joint of ball can't be fast: it has no one coordinate"
    with pytest.raises(ValueError, match=re.escape(message)):
        Mechanism([Link("ball", POINT, joint)], fast_joints=["ball"])


@pytest.mark.parametrize("joint", [REVOLUTE, PRISMATIC])
def test_a_joint_of_one_coordinate_can_be_fast(joint: int) -> None:
    assert Mechanism([Link("ball", POINT, joint)], fast_joints=["ball"]).n_slow == 0


@pytest.mark.parametrize(
    ("links", "fast", "said"),
    [
        ([], [], "one link at least"),
        (["a", "a"], [], "names of their own"),
        (["a"], ["b"], "no link is named b"),
    ],
)
def test_names_that_do_not_fit_are_refused(links: list[str], fast: list[str], said: str) -> None:
    gram = rigid_gram(1.0, np.zeros(3), np.eye(3))
    with pytest.raises(ValueError, match=said):
        Mechanism([Link(name, gram, REVOLUTE) for name in links], fast)


def test_an_axis_without_direction_is_refused() -> None:
    gram = rigid_gram(1.0, np.zeros(3), np.eye(3))
    with pytest.raises(ValueError, match="the axis of a has no direction"):
        Mechanism([Link("a", gram, REVOLUTE, axis=np.zeros(3))])


def test_a_slow_oscillator_limits_the_sub_cycled_step_by_its_own_long_one() -> None:
    # A mass of 2 kg on a spring of 8 N/m: ω = 2 rad/s, so m h < 2/ω = 1 s (central difference's limit).
    gram = rigid_gram(2.0, np.zeros(3), np.eye(3))
    tree = Mechanism([Link("a", gram, PRISMATIC, spring=8.0)])
    assert Subcycling(1.0, 10).largest_step(tree) == pytest.approx(0.1, rel=1e-12)
