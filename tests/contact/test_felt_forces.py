"""Loads and force elements beside contacts: points of faces give way to them beyond the modes, as whole elements do."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import nnls

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.fem.markers import Marker
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.protocol import evaluate
from fmd.output.contact_faults import start_faults
from fmd.output.contacts import contact_warnings
from tests.contact.test_contact_points import BLOCK

CLEARANCE = 1e-7
LOW = ["100 mm", "-50 mm", "0 mm"]
SPOT = ["200 mm", "-50 mm", "0 mm"]
NODE = LOW  # by a marker there and by one at the point it moves alike, and turns otherwise


def cantilever(*overrides: str, **tables: Any) -> Pipeline:
    """Return the block held at one end by 3 modes, its other end just before a wall."""
    shape = BLOCK["body"]["block"]
    markers = shape["marker"] | {"end": {"face": "x+"}, "spot": {"at": SPOT}}
    body = shape | {"modes": {"count": 3, "enrich": "none"}, "support": [{"face": "x-"}]}
    body["marker"] = markers | {"root": {"face": "x-"}, "node": {"node": NODE}, "point": {"at": NODE}}
    ground = {"root": {"at": [0, 0, 0]}, "ahead": {"at": ["300 mm", "-50 mm", "0 mm"]}}
    ground["wall"] = {"at": ["200 mm", 0, 0]}
    scene = {
        "body": {"block": body},
        "ground": ground,
        "joint": {"hold": {"type": "fixed", "parent": "ground.root", "child": "block.root"}},
        "contact": {"wall": {"between": ["ground.wall", "block.end"], "normal": [-1, 0, 0], "clearance": CLEARANCE}},
    }
    more = {"gravity": [0, 0, 0], "tip": "block.end", "start": "equilibrium"}
    return Pipeline(load_scene(BLOCK | scene | {"simulation": BLOCK["simulation"] | more} | tables, overrides))


def force_on(marker: str, force: Any, direction: list[float]) -> dict[str, Any]:
    load = {"type": "point force", "marker": f"block.{marker}", "direction": direction, "force": force}
    return {"drive": {"load": load}}


SIZE = float(np.hypot(3000.0, 900.0))
TORQUE = {"type": "point torque", "marker": "block.bottom", "direction": [0, 0, 1], "torque": "-600 N m"}
BOTH = {**force_on("point", "3 kN", [1, 0, 0])["drive"], "turn": TORQUE | {"marker": "block.node"}}
SPRING = {"between": ["ground.ahead", "block.spot"], "stiffness": "20 N/mm", "length": "50 mm"}
CASES: dict[str, tuple[dict[str, Any], str, list[float]]] = {
    "force on the face": (force_on("end", SIZE, [1, 0.3, 0]), "end", [3000, 900, 0, 0, 0, 0]),
    "force beside it": (force_on("bottom", "3 kN", [1, 0, 0]), "bottom", [3000, 0, 0, 0, 0, 0]),
    "torque": ({"drive": {"load": TORQUE}}, "bottom", [0, 0, 0, 0, 0, -600]),
    "torque on a node beside a force": ({"drive": BOTH}, "node", [3000, 0, 0, 0, 0, -600]),
    "spring": ({"spring": {"pull": SPRING}}, "spot", [1000, 0, 0, 0, 0, 0]),
}


def whole_forces(run: Pipeline, marker: Marker, wrench: Array) -> Array:
    """Return the normal forces on the face's points by all elements, held at the end, without modes."""
    part, at = run.parts["block"], 3 * run.parts["block"].contact_points.nodes
    n = 3 * len(part.fe.x)
    held = np.flatnonzero(part.fe.x[:, 0] < 1e-9)
    B = np.eye(n)[:, (3 * held[:, None] + np.arange(3)).ravel()]
    if not part.shape.support:  # by the joint alone, whose marker doesn't move in the mean
        B = part.markers["root"].columns(len(part.fe.x), np.eye(3)).reshape(n, -1)
    f = marker.columns(len(part.fe.x), np.eye(3)).reshape(-1, 6) @ wrench
    B = B * 1e12  # as stiff as the mesh
    flexibility = np.linalg.inv(np.block([[part.fe.K.toarray(), B], [B.T, np.zeros((B.shape[1], B.shape[1]))]]))[:n, :n]
    L = np.linalg.cholesky(flexibility[np.ix_(at, at)])
    force, _ = nnls(L.T, -np.linalg.solve(L, CLEARANCE - flexibility[at] @ f), maxiter=1000)
    return np.asarray(force)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_points_give_way_to_loads_and_springs_as_whole_elements_do(
    case: tuple[dict[str, Any], str, list[float]],
) -> None:
    """By the modes alone forces were up to a half too small, and points beside were open."""
    tables, marker, wrench = case
    run = cantilever(**tables)
    parameters: Any = run.system.parameters
    evaluate(parameters, 0.0, *run.start, np.zeros(run.system.n))
    exact = whole_forces(run, run.parts["block"].markers[marker], np.array(wrench, dtype=float))
    np.testing.assert_allclose(parameters.contact.force[:, 0], exact, atol=2e-3 * exact.max())


@pytest.mark.parametrize("case", ["force on the face", "force beside it", "torque"])
def test_points_of_a_body_that_a_joint_holds_alone_give_way_as_its_whole_elements_do_there(case: str) -> None:
    """As those of a free body, whose joint's force deflected none, they were off by 17, 41 and 38 %."""
    tables, marker, wrench = CASES[case]
    run = cantilever("body.block.support=[]", **tables)
    parameters: Any = run.system.parameters
    evaluate(parameters, 0.0, *run.start, np.zeros(run.system.n))
    exact = whole_forces(run, run.parts["block"].markers[marker], np.array(wrench, dtype=float))
    np.testing.assert_allclose(parameters.contact.force[:, 0], exact, atol=1e-4 * exact.max())
    assert not [each for each in contact_warnings(run) if each["code"] == "contact-joint"]


@pytest.mark.parametrize("place", ['{ face = "x+" }', '{ at = ["200 mm", "-50 mm", "30 mm"] }'])
def test_a_joint_on_the_face_that_touches_leaves_it_the_flexibility_of_a_free_body(place: str) -> None:
    """Held by their own reaction its points couldn't give way, and the scene was refused."""
    part = cantilever("body.block.support=[]", f"body.block.marker.root={place}").parts["block"]
    points, R = part.contact_points, part.fe.rigid_modes
    balance = np.eye(len(R)) - part.fe.M @ R @ np.linalg.solve(R.T @ (part.fe.M @ R), R.T)
    exact = balance.T @ np.linalg.pinv(part.fe.K.toarray(), 1e-10, hermitian=True) @ balance
    at = (3 * points.nodes[:, None] + np.arange(3)).ravel()
    whole = part.model.solver_on_joint(part.contact_faces).flexibility(points.nodes)
    np.testing.assert_allclose(whole, exact[np.ix_(at, at)], atol=1e-7 * np.abs(exact).max())
    assert np.linalg.eigvalsh(points.G.reshape(len(at), -1))[0] > 0.0


@pytest.mark.parametrize(("start", "told"), [("equilibrium", []), ("undeformed", ["contact-start"])])
def test_the_balance_has_no_energy_of_a_load_that_shakes_the_face(start: str, told: list[str]) -> None:
    """What the contact's steps make or lose, beside the most that is stored in it; an undeformed start rings."""
    shaken = force_on("end", {"formula": "3000 + 2500*sin(2*pi*t/0.002)", "unit": "N"}, [1, 0, 0])
    more = {"duration": "4 ms", "output_step": "20 us", "gravity": [0, 0, 0], "tip": "block.end", "start": start}
    run = cantilever(simulation=BLOCK["simulation"] | more, **shaken)
    own = run.motion.contacts["wall"]
    assert own.energy.max() > 0.0
    assert np.abs(own.energy_error).max() < 0.01 * own.energy.max()
    assert [each["code"] for each in contact_warnings(run)] == told


def test_an_implicit_method_passes_where_points_beside_static_responses_begin_to_slip() -> None:
    """These responses move by less than surfaces that begin to slip, so that whole corrections go to and fro."""
    body = BLOCK["body"]["block"] | {"support": [{"face": "x-"}], "modes": {"count": 8, "enrich": "inertia"}}
    body["marker"] = body["marker"] | {"end": {"face": "x+"}, "root": {"face": "x-"}}
    shaken = force_on("end", {"formula": "2000*sin(2*pi*3000*t)", "unit": "N"}, [0, 1, 0])["drive"]["load"]
    drives = force_on("end", "20 kN", [1, 0, 0])["drive"] | {"shaken": shaken}
    contact = {"between": ["ground.wall", "block.end"], "normal": [-1, 0, 0], "friction": 0.3}
    more = {"gravity": [0, 0, 0], "tip": "block.end", "start": "equilibrium", "duration": 1.5e-4, "output_step": 5e-5}
    found = list[Array]()
    for method in ({"integrator": "generalized-alpha", "step": 2e-6, "rho": 0}, {"step": 2e-8}):
        simulation = BLOCK["simulation"] | more | {"run": [BLOCK["simulation"]["run"][0] | method]}
        run = cantilever(body={"block": body}, drive=drives, contact={"wall": contact}, simulation=simulation)
        own = run.motion.contacts["wall"]
        found.append(np.append(own.impulse[-1, :2], own.friction_work[-1]))
    implicit, explicit = found
    np.testing.assert_allclose(implicit[:2], explicit[:2], rtol=0.01)
    assert implicit[2] == pytest.approx(explicit[2], rel=0.03)


def shaken_block(force: float, frequency: float, duration: float, **run: Any) -> Pipeline:
    """Return the block with static responses, pressed on a wall by 20 kN and shaken along it at a node [N, Hz, s]."""
    body = BLOCK["body"]["block"] | {"support": [{"face": "x-"}], "modes": {"count": 8, "enrich": "inertia"}}
    body["marker"] = body["marker"] | {"end": {"face": "x+"}, "root": {"face": "x-"}, "spot": {"at": SPOT}}
    load = {"formula": f"{force}*sin(2*pi*{frequency}*t)", "unit": "N"}
    drives = force_on("end", "20 kN", [1, 0, 0])["drive"] | {
        "shaken": force_on("spot", load, [0, 1, 0])["drive"]["load"]
    }
    contact = {"between": ["ground.wall", "block.end"], "normal": [-1, 0, 0], "friction": 0.3}
    more = {"gravity": [0, 0, 0], "tip": "block.end", "start": "equilibrium", "duration": duration, "output_step": 2e-5}
    simulation = BLOCK["simulation"] | more | {"run": [BLOCK["simulation"]["run"][0] | run]}
    return cantilever(body={"block": body}, drive=drives, contact={"wall": contact}, simulation=simulation)


@pytest.mark.parametrize("rho", [0.0, 0.8, 1.0])
def test_friction_of_stiff_points_has_one_force_for_a_step_where_it_has_several_for_its_positions(rho: float) -> None:
    """Forces from positions alone went to and fro between two that suit them, whatever the step.

    With the weights of another ρ than 0 they threw points that came back within a step out again too fast.
    """
    found = list[Array]()
    for step in (1e-6, 2.5e-7):
        run = shaken_block(4000.0, 12e3, 2e-4, integrator="generalized-alpha", step=step, rho=rho)
        own = run.motion.contacts["wall"]
        assert own.lost_part(run.motion.energies[0]) < 0.01
        assert own.impulse[-1, 0] == pytest.approx(-20e3 * 2e-4, rel=0.02)
        found.append(np.append(own.impulse[-1, :2], own.friction_work[-1]))
    np.testing.assert_allclose(found[0][::2], found[1][::2], rtol=0.02)


def test_forces_found_for_a_step_as_a_whole_deflect_its_points_by_their_own_flexibility_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What they move modes by is in the positions; closed points stand on the wall."""
    steps, tables = GeneralizedAlpha.steps, list[Any]()

    def keep(method: GeneralizedAlpha, system: Any, p: Any, *rest: Any) -> Any:
        tables.append(p.contact)
        return steps(method, system, p, *rest)

    monkeypatch.setattr(GeneralizedAlpha, "steps", keep)
    run = shaken_block(4000.0, 12e3, 1e-4, integrator="generalized-alpha", step=1e-6, rho=0)
    assert run.motion.contacts["wall"].friction_work[-1] > 0.0
    c, G = tables[-1], run.parts["block"].contact_points.G
    moved = np.einsum("iajb,jb->ia", G, c.own)
    np.testing.assert_allclose(c.moved, moved, atol=c.noise.max())  # as round-off of places lets forces settle
    gaps = c.free[:, 0] + np.einsum("ik,ik->i", c.turned[:, 0], c.moved)
    pressed = c.force[:, 0] > 0.0
    assert pressed.any()
    np.testing.assert_allclose(gaps[pressed], 0.0, atol=1e-9 * np.abs(moved).max())
    assert (gaps > -1e-9 * np.abs(moved).max()).all()
    assert (np.hypot(c.force[:, 1], c.force[:, 2]) <= 0.3 * c.force[:, 0] * (1.0 + 1e-9)).all()


def test_a_contact_that_presses_within_its_own_vibration_presses_from_the_start() -> None:
    """Runge–Kutta's steps of a block that lies on a floor: 19 ns in the mean, of which its first are longer."""
    motion = SimpleNamespace(
        contacts={"floor": SimpleNamespace(span=(48e-9, 2e-3))}, trajectory=SimpleNamespace(step=19e-9)
    )
    compiled = SimpleNamespace(residual=lambda *_: np.ones(1))
    scene = SimpleNamespace(simulation=SimpleNamespace(start="undeformed"))
    for longest, told in ((3e-6, 1), (1e-9, 0)):
        system = SimpleNamespace(compiled=compiled, shock_step=longest)
        run: Any = SimpleNamespace(start=np.zeros((2, 1)), system=system, motion=motion, scene=scene)
        assert len([*start_faults(run)]) == told


def test_a_start_that_presses_by_round_off_alone_is_no_false_alarm() -> None:
    """Without a load what presses at the start is an interference; of 1e-14 m it is that of places."""
    compiled = SimpleNamespace(residual=lambda *_: np.zeros(1))
    system = SimpleNamespace(compiled=compiled, shock_step=1e-9)
    scene = SimpleNamespace(simulation=SimpleNamespace(start="undeformed"))
    for pressed, told in ((1e-8, 0), (0.1, 1)):
        own = SimpleNamespace(span=(0.0, 2e-3), force=np.array([[0.0, pressed, 0.0]]), largest=(1.0, 0.0, 0.0))
        motion = SimpleNamespace(contacts={"floor": own}, trajectory=SimpleNamespace(step=19e-9))
        run: Any = SimpleNamespace(start=np.zeros((2, 1)), system=system, motion=motion, scene=scene)
        assert len([*start_faults(run)]) == told


def test_explicit_steps_pass_where_forces_of_friction_go_round_in_circles_from_the_last_ones() -> None:
    """From no forces they settle. Static responses ring, so that points lift."""
    body = BLOCK["body"]["block"] | {"support": [{"face": "x-"}], "modes": {"count": 8, "enrich": "inertia"}}
    body["marker"] = body["marker"] | {"end": {"face": "x+"}, "root": {"face": "x-"}, "spot": {"at": SPOT}}
    shaken = force_on("spot", {"formula": "8000*sin(2*pi*12000*t)", "unit": "N"}, [0, 1, 0])["drive"]["load"]
    drives = force_on("end", "20 kN", [1, 0, 0])["drive"] | {"shaken": shaken}
    contact = {"between": ["ground.wall", "block.end"], "normal": [-1, 0, 0], "friction": 0.3}
    more = {"gravity": [0, 0, 0], "tip": "block.end", "start": "equilibrium", "duration": 4e-5, "output_step": 2e-5}
    run = [BLOCK["simulation"]["run"][0] | {"step": 2e-8}]
    ground = {"root": {"at": [0, 0, 0]}, "wall": {"at": ["200 mm", 0, 0]}}
    simulation = BLOCK["simulation"] | more | {"run": run}
    own = cantilever(
        body={"block": body}, drive=drives, contact={"wall": contact}, ground=ground, simulation=simulation
    )
    assert own.motion.contacts["wall"].impulse[-1, 0] == pytest.approx(-20e3 * 4e-5, rel=0.03)


@pytest.mark.parametrize(("enrich", "told"), [("none", True), ("inertia", False)])
def test_a_spring_that_would_be_stretched_otherwise_beside_the_modes_is_told_by_how_much(
    enrich: str, told: bool
) -> None:
    """Its force by all elements, held at the end, under the load and the forces that these have at the wall."""
    shape, stiffness, force = BLOCK["body"]["block"], 1e9, np.array([30e3, 3e3, 0.0])
    markers = shape["marker"] | {"end": {"face": "x+"}, "root": {"face": "x-"}, "low": {"at": LOW}}
    body = shape | {"modes": {"count": 3, "enrich": enrich}, "support": [{"face": "x-"}], "marker": markers}
    ground = {"root": {"at": [0, 0, 0]}, "wall": {"at": ["200 mm", 0, 0]}, "below": {"at": LOW}}
    pull = {"between": ["ground.below", "block.low"], "stiffness": [stiffness, 0, 0, 0, 0, 0]}
    load = force_on("end", float(np.linalg.norm(force)), force.tolist())
    more = {"gravity": [0, 0, 0], "tip": "block.end", "start": "equilibrium", "duration": 4e-5, "output_step": 2e-5}
    simulation = BLOCK["simulation"] | more
    others = {"between": pull["between"], "damper": [10, 0, 0, 0, 0, 0]}
    along = {"between": ["ground.root", "block.end"], "stiffness": 1.0}
    pulls = {"bushing": {"pull": pull, "slow": others}, "spring": {"pull": along}}
    run = cantilever(body={"block": body}, ground=ground, simulation=simulation, **pulls, **load)
    part, points = run.parts["block"], run.parts["block"].contact_points
    n = len(part.fe.x)
    solver, end, low = part.model.solver, part.markers["end"], part.markers["low"]
    u = solver.static_response(np.stack([own.columns(n, np.eye(3))[:, :, 0] for own in (end, low)], axis=2))
    side = solver.static_response(end.columns(n, np.eye(3))[:, :, 1:2])[:, :, 0]
    stretched, pulled = force[0] * u[:, :, 0] + force[1] * side, u[:, :, 1]
    flexible = solver.flexibility(points.nodes)[::3, ::3]
    weight = low.columns(n, np.eye(3))[:, 0, 0]
    soft = 1.0 + stiffness * weight @ pulled[:, 0]
    D = flexible - stiffness / soft * np.outer(pulled[points.nodes, 0], pulled[points.nodes, 0])
    free = stretched - stiffness / soft * pulled * (weight @ stretched[:, 0])
    L = np.linalg.cholesky(D)
    pressed, _ = nnls(L.T, -np.linalg.solve(L, CLEARANCE - free[points.nodes, 0]), maxiter=1000)
    exact = stiffness / soft * (weight @ stretched[:, 0] - pulled[points.nodes, 0] @ pressed)
    _, element, _ = run.motion.mechanism.elements
    off = abs(run.motion.kinematics.wrenches(element)[0, 0, 0]) / exact - 1.0
    texts = [each["text"] for each in contact_warnings(run) if each["code"] == "contact-spring"]
    assert not any(each.startswith("bushing.slow") for each in texts)  # whose forces are no stretch's
    (text,) = [each for each in texts if each.startswith("bushing.pull")] or [" 0%"]
    assert told == (text != " 0%")
    assert float(text.partition("%")[0].split()[-1]) / 100.0 == pytest.approx(off, rel=0.15, abs=0.01)


def test_a_block_starts_at_rest_where_large_forces_at_its_points_cancel_on_its_modes() -> None:
    """Pressed by 20 kN along its axis, which four bending modes don't feel: they stay straight, by symmetry."""
    body = BLOCK["body"]["block"] | {"support": [{"face": "x-"}], "modes": {"count": 4, "enrich": "none"}}
    body["marker"] = body["marker"] | {"end": {"face": "x+"}, "root": {"face": "x-"}, "spot": {"at": SPOT}}
    contact = {"between": ["ground.wall", "block.end"], "normal": [-1, 0, 0], "friction": 0.3}
    ground = {"root": {"at": [0, 0, 0]}, "wall": {"at": ["200 mm", 0, 0]}}
    run = cantilever(
        body={"block": body}, contact={"wall": contact}, ground=ground, **force_on("end", "20 kN", [1, 0, 0])
    )
    q, v = run.start[:2]
    assert q == pytest.approx(0.0, abs=1e-15)  # a thousandth of a millionth of what 1 N bends
    assert not v.any()
