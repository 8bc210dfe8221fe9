"""A mass matrix that displacements of second order rob of its positive definiteness ends a run with the figure."""

from pathlib import Path

import numpy as np
import pytest

from pipeline import Pipeline, load_scene
from pipeline.core.errors import AccuracyError, StabilityError
from pipeline.dynamics.compiled_system.positive_mass import (
    explain_failure,
    require_positive_mass,
    require_positive_over,
)

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
BENDING = 210e9 * 0.02 * 0.005**3 / 12


def chain(folder: Path, deflection: float, start: str = "steady") -> Pipeline:
    """Return a clamped chain of three stiffened bars under a force that would bend one bar by a part of its length."""
    bodies = "".join(PIECE.format(k=k, parent=f"strip{k - 1}.tip" if k else "ground") for k in range(3))
    end = END.replace("FORCE", repr(3 * deflection * BENDING)).replace("START", start)
    (folder / "chain.toml").write_text('title = "Chain"\n' + bodies + end)
    return Pipeline(load_scene(folder / "chain.toml"))


def test_a_steady_state_that_leaves_a_motion_without_inertia_is_refused(tmp_path: Path) -> None:
    message = r"in the steady state the mass matrix isn't positive definite: a motion has -\S+ times its inertia"
    with pytest.raises(AccuracyError, match=message):
        _ = chain(tmp_path, 0.2).start
    q0, _ = chain(tmp_path, 0.002).start
    assert np.isfinite(q0).all()


def test_a_motion_and_a_march_that_ended_are_checked_alike(tmp_path: Path) -> None:
    run = chain(tmp_path, 0.0, "undeformed")
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
