"""The model's full mass matrix, its mass and its rigid modes."""

import numpy as np
import pytest
import scipy.sparse as sp

from fmd.fem.model import FEModel


def test_the_full_mass_matrix_has_the_scalar_one_for_each_axis(distorted: FEModel) -> None:
    assert abs(distorted.M - sp.kron(distorted.m, sp.eye_array(3))).max() == 0.0
    assert distorted.mass == pytest.approx(distorted.M.sum() / 3, rel=1e-13)


def test_rigid_modes_move_a_point_as_a_turn_does(distorted: FEModel) -> None:
    turns = distorted.rigid_modes.reshape(-1, 3, 6)[:, :, 3:]
    for a in range(3):
        assert np.abs(turns[:, :, a] - np.cross(np.eye(3)[a], distorted.x)).max() < 1e-15
