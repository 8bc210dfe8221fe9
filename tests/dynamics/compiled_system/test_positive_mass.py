"""Displacements of second order and the mass matrix: what keeps it positive definite, and what is said if it isn't."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.errors import AccuracyError, StabilityError
from fmd.dynamics.compiled_system import steady
from fmd.dynamics.compiled_system.positive_mass import (
    explain_failure,
    require_positive_mass,
    require_positive_over,
)
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.stages.stiffening_check import with_whole_energy

PIECE = """
[body.strip{k}]
shape = "bar"
length = "0.3333333 m"
depth = "0.02 m"
width = "0.005 m"
E = "210 GPa"
nu = 0.0
rho = "7850 kg/m^3"
mesh = {{ element = "hexahedron", order = 2, divisions = [6, 1, 1] }}
modes = {{ count = 3, boundary = "joint", enrich = "inertia" }}
marker = {{ root = {{ face = "x-" }}, tip = {{ face = "x+" }} }}
[joint.clamp{k}]
type = "fixed"
parent = "{parent}"
child = "strip{k}.root"
"""
END = """
[drive.load]
type = "point force"
marker = "strip2.tip"
direction = [0, 0, 1]
force = "FORCE N"
[simulation]
duration = "1 ms"
output_step = "1 ms"
start = "START"
tip = "strip2.tip"
stiffening = "on"
run = [{ integrator = "runge-kutta" }]
"""
WEIGHT = 'gravity = ["-9.81 m/s^2", "0 m/s^2", "-9.81 m/s^2"]'
BENDING = 210e9 * 0.02 * 0.005**3 / 12


TURN = """
[drive.turn]
type = "motion"
joint = "clamp0"
angle = { formula = "20*t", unit = "rad" }
"""


def chain(folder: Path, deflection: float, start: str = "steady", turning: bool = False) -> Pipeline:
    """Return a chain of three stiffened bars under a force that would bend one bar by a part of its length.

    It is clamped, or turns across the plane of its bending.
    """
    bodies = "".join(PIECE.format(k=k, parent=f"strip{k - 1}.tip" if k else "ground") for k in range(3))
    end = END.replace("FORCE", repr(3 * deflection * BENDING)).replace("START", start)
    if turning:
        hinge = '[joint.clamp0]\ntype = "revolute"\naxis = [0, 1, 0]'
        bodies, end = bodies.replace('[joint.clamp0]\ntype = "fixed"', hinge), end + TURN
    (folder / "chain.toml").write_text('title = "Chain"\n' + bodies + end)
    return Pipeline(load_scene(folder / "chain.toml"))


@pytest.mark.parametrize("deflection", [0.2, 0.4])
def test_a_bent_chain_has_inertia_against_every_motion(tmp_path: Path, deflection: float) -> None:
    """At 0.2 it was -0.6 times the undeformed chain's as long as spin was thought to draw in what doesn't spin."""
    run = chain(tmp_path, deflection)
    q0, _ = run.start
    assert np.linalg.eigvalsh(run.system.mass_matrix(q0))[0] > 0


@pytest.mark.parametrize(("deflection", "turning"), [(2.0, False), pytest.param(1.0, True, marks=pytest.mark.long)])
def test_a_chain_that_is_bent_far_is_at_rest_in_its_steady_state(
    tmp_path: Path, deflection: float, turning: bool
) -> None:
    run = chain(tmp_path, deflection, turning=turning)
    q0, v0 = run.start
    undeformed, _ = chain(tmp_path, 0.0, turning=turning).start
    left = np.abs(run.system.compiled.accelerations(0.0, q0, v0)).max()
    assert left < 1e-9 * np.abs(run.system.compiled.accelerations(0.0, undeformed, v0)).max()


@pytest.mark.parametrize(
    ("deflection", "turning", "message"),
    [
        (10.0, False, "no steady state: a deflection grows by itself"),
        (5.0, True, "in the steady state the mass matrix isn't positive definite"),
    ],
)
def test_a_force_that_no_steady_state_bears_is_refused(
    tmp_path: Path, deflection: float, turning: bool, message: str
) -> None:
    with pytest.raises(AccuracyError, match=message):
        _ = chain(tmp_path, deflection, turning=turning).start


def test_a_steady_state_that_takes_too_many_corrections_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bent farther, corrections wander, and round-off decides whether they meet a steady state."""
    monkeypatch.setattr(steady, "_TOLERANCE", replace(steady._TOLERANCE, corrections=2))
    with pytest.raises(AccuracyError, match=r"the modes still change by .* after 2 corrections; .* bends them too far"):
        _ = chain(tmp_path, 2.0).start


def test_a_mass_matrix_that_round_off_spoils_undeformed_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = chain(tmp_path, 0.0, "undeformed", turning=True)
    M = run.system.mass_matrix(run.start[0])
    lightest = np.linalg.eigh(M)[1][:, 0]
    spoiled = M - 2 * (lightest @ M @ lightest) * np.outer(lightest, lightest)
    monkeypatch.setattr(type(run.system), "mass_matrices", lambda self, q: np.stack([spoiled] * len(q)))
    with pytest.raises(AccuracyError, match=r"nor is that of the undeformed mechanism: .* fewer modes help"):
        require_positive_mass(run.system, run.start[0], "at t = 1 s")


def test_a_motion_and_a_march_that_ended_are_checked_alike(tmp_path: Path) -> None:
    run = chain(tmp_path, 0.0, "undeformed", turning=True)
    system = run.system
    still = run.start[0]
    bent = still.copy()
    for link in range(3):  # some 0.2 m each
        bent[system.mechanism.modes_of(link)[0] + system.n_positions - system.n] = 0.1  # m √kg
    require_positive_mass(system, still, "at rest")
    with pytest.raises(AccuracyError, match=r"at t = 0\.5 s the mass matrix isn't positive definite"):
        explain_failure(system, StabilityError("it stopped", 0.5, bent))
    explain_failure(system, StabilityError("it stopped", 0.5, still))  # for another reason
    explain_failure(system, StabilityError("it stopped"))
    with pytest.raises(AccuracyError, match=r"at t = 1 s the mass matrix isn't positive definite"):
        require_positive_over(system, np.array([0.0, 1.0]), np.stack([still, bent]))
    with pytest.raises(AccuracyError, match=r"in the steady state .*: a motion has -\S+ times its inertia"):
        require_positive_mass(system, bent, "in the steady state")
    whole = CompiledSystem(with_whole_energy(system.mechanism))
    require_positive_mass(whole, bent, "with the whole energy", 1e-4)
    explain_failure(whole, StabilityError("it stopped", 0.5, bent))  # for another reason


@pytest.mark.parametrize("enrich", ["none", "inertia"])
def test_displacements_of_second_order_leave_the_kinetic_energy_positive(tmp_path: Path, enrich: str) -> None:
    """A pushed bar on a slider, bent by up to 30 % of its length; its frame's coupling with its modes takes it all."""
    bar = PIECE.format(k=0, parent="ground").replace('"fixed"', '"prismatic"\naxis = [0, 0, 1]')
    bar = bar.replace("count = 3", "count = 6").replace("inertia", enrich)
    end = END.replace("strip2", "strip0").replace("FORCE", "1").replace("START", "undeformed")
    (tmp_path / "bar.toml").write_text(f'title = "Bar"\n{bar}{end}'.replace("run =", f"{WEIGHT}\nrun ="))
    run = Pipeline(load_scene(tmp_path / "bar.toml"))
    (link,), modes = run.mechanism.links, run.mechanism.modes_of(0)
    assert link.integrals.second_order is not None
    shapes = run.bodies["strip0"].markers["tip"].translation
    for k, part in ((0, 0.1), (1, 0.1), (0, 0.3), (1, 0.3)):
        q = run.mechanism.rest_positions.copy()
        q[modes[k]] = part * 0.3333333 / np.linalg.norm(shapes[:, k])
        M = run.system.mass_matrix(q)
        assert np.linalg.eigvalsh(M)[0] > 0
        M[np.ix_(modes, modes)] -= link.integrals.second_order.matrix(q[modes])
    assert np.linalg.eigvalsh(M)[0] < -0.5
