"""The propeller at 8000 rpm: the reduced body against the whole finite element model, solved another way."""

from functools import cache
from math import pi

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.fem.model import FEModel
from fmd.recovery.stress import modal_stress, von_mises
from fmd.reduction.body import FlexibleBody

RATE = 8000 * 2 * pi / 60


@cache
def propeller(*overrides: str) -> Pipeline:
    return Pipeline(load_scene("propeller", overrides))


@cache
def whole_model() -> tuple[FEModel, Array, Array]:
    """The model, its centrifugal load and its static deflection with the bore held: K with six unknowns pinned.

    Pinning six unknowns of a free body under a load in equilibrium causes no reaction; the rigid motion that is left
    open is the one that holds the bore in the mean.
    """
    run = propeller()
    fe, hub = run.fe, run.part.markers["hub"]
    load = RATE**2 * (fe.m @ (fe.x * (1, 1, 0))).ravel()
    B, R = hub.columns(len(fe.x), np.eye(3)).reshape(len(load), 6), fe.rigid_modes
    load_and_reaction = load - B @ np.linalg.solve(R.T @ B, R.T @ load)
    a, b, c = 0, int(np.argmax(fe.x[:, 0])), int(np.argmax(fe.x[:, 1]))
    pinned = choose_six(R, [3 * node + axis for node in (a, b, c) for axis in range(3)])
    free = np.setdiff1d(np.arange(len(load)), pinned)
    u = np.zeros(len(load))
    K = sp.csc_array(fe.K[free][:, free])
    u[free] = splu(K, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}).solve(
        load_and_reaction[free]
    )
    assert np.linalg.norm(fe.K @ u - load_and_reaction) < 1e-9 * np.linalg.norm(load)
    u -= R @ np.linalg.solve(B.T @ R, B.T @ u)
    return fe, load, u.reshape(-1, 3)


def choose_six(R: Array, unknowns: list[int]) -> list[int]:
    """The first six unknowns that leave no rigid motion."""
    chosen: list[int] = []
    for unknown in unknowns:
        if np.linalg.matrix_rank(R[[*chosen, unknown]]) > len(chosen):
            chosen.append(unknown)
    return chosen


def lacks(run: Pipeline, body: FlexibleBody) -> tuple[float, float]:
    """Largest error of displacement over the joints' largest, and of von Mises stress over its own value there."""
    fe, load, u = whole_model()
    reduced = body.shapes @ ((body.shapes.reshape(len(load), -1).T @ load) / body.omega**2)
    joints = np.unique(fe.discretisation.element_nodes[run.mesh.parts["joints"]])
    displacement = np.linalg.norm(reduced - u, axis=1)[joints].max() / np.linalg.norm(u, axis=1)[joints].max()
    both = np.stack([u, reduced], axis=2)
    ours, theirs = von_mises(modal_stress(fe.discretisation, fe.material, both, joints)).T[::-1]
    return float(displacement), float(np.abs(ours / theirs - 1).max())


@pytest.mark.long  # test_enrichment.py has a rod's, in a second
def test_28_shapes_give_the_steady_stress_everywhere_on_the_joints() -> None:
    run = propeller()
    assert len(run.part.body.omega) <= 30
    displacement, stress = lacks(run, run.part.body)
    assert displacement < 0.01
    assert stress < 0.01


@pytest.mark.long
def test_30_free_modes_alone_dont() -> None:
    """Why the basis is enriched: bending modes hold almost none of the stretch."""
    run = propeller("body.propeller.modes.enrich=none", "body.propeller.modes.count=30")
    displacement, stress = lacks(run, run.part.body)
    assert displacement > 0.5
    assert stress > 0.2
