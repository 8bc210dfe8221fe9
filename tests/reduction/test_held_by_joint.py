"""Static responses of a body that a joint holds, beside dense equations with its reaction among the unknowns."""

import numpy as np
import pytest

from fmd.fem.model import FEModel
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.held_by_joint import JointHeldSolver
from tests.reduction.test_held_modes import JOINTS, marker_of


@pytest.mark.parametrize("joint", JOINTS)
def test_a_joint_holds_a_body_with_the_reaction_of_dense_equations(small_bar: FEModel, joint: str) -> None:
    about, n_rigid = JOINTS[joint]
    n = 3 * len(small_bar.x)
    B = marker_of(small_bar, "x-").columns(len(small_bar.x), about)
    solver = JointHeldSolver(small_bar, FreeBodySolver(small_bar), B)
    held, Z = 1e9 * B.reshape(n, -1), solver.rigid_modes
    assert Z.shape[1] == n_rigid
    rows = np.concatenate([held, small_bar.M @ Z], axis=1)  # Z is balanced by inertia, and left out of displacements
    none = np.zeros((rows.shape[1], rows.shape[1]))
    exact = np.linalg.inv(np.block([[small_bar.K.toarray(), rows], [rows.T, none]]))[:n, :n]
    f = np.random.default_rng(0).standard_normal((len(small_bar.x), 3, 2))
    u = (exact @ f.reshape(n, 2)).reshape(f.shape)
    for respond in (solver.static_response, solver.remembered_response):
        np.testing.assert_allclose(respond(f), u, atol=1e-8 * np.abs(u).max())
    nodes = marker_of(small_bar, "x+").nodes
    some = (3 * nodes[:, None] + np.arange(3)).ravel()
    G = exact[np.ix_(some, some)]
    np.testing.assert_allclose(solver.flexibility(nodes), G, atol=1e-8 * np.abs(G).max())
    np.testing.assert_allclose(solver.responder()(nodes, np.eye(len(some))), G, atol=1e-8 * np.abs(G).max())
