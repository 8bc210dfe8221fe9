"""PETSc and SLEPc over two MPI ranks, beside the solver in this process."""

import os
import shutil
from functools import partial
from importlib.util import find_spec

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.cache import Cache
from fmd.core.errors import AccuracyError, InputError
from fmd.fem.markers import face_marker
from fmd.fem.model import FEModel
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.factor import slepc
from fmd.reduction.factor.slepc import factorise_over_ranks

installed = pytest.mark.skipif(
    find_spec("slepc4py") is None and slepc.PYTHON not in os.environ, reason="slepc4py is not installed"
)
two_ranks = pytest.mark.skipif(shutil.which("mpiexec") is None, reason="mpiexec is not installed")
BAR = ["body.beam.mesh.divisions=[12,2,1]", "body.beam.modes.solver='slepc'"]


@pytest.fixture(autouse=True)
def mpi(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let Open MPI run in a container: as root, with more processes than cores."""
    for name in ("ALLOW_RUN_AS_ROOT", "ALLOW_RUN_AS_ROOT_CONFIRM", "MCA_rmaps_base_oversubscribe"):
        monkeypatch.setenv(f"OMPI_{name}", "1")


@installed
@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=two_ranks)])
def test_free_held_and_static_fields_are_those_of_one_process(ranks: int, small_bar: FEModel) -> None:
    one, spread = (
        FreeBodySolver(small_bar),
        FreeBodySolver(small_bar, factorise=partial(factorise_over_ranks, ranks=ranks)),
    )
    marker = face_marker(small_bar.discretisation, small_bar.discretisation.mesh.faces["x-"])
    for held in (None, marker.columns(len(small_bar.x), np.eye(3))):
        expected, found = one.modes(10, held), spread.modes(10, held)
        assert found.omega == pytest.approx(expected.omega, rel=1e-8)
        assert found.n_rigid == expected.n_rigid
        Phi, same = (pairs.shapes.reshape(-1, 10) for pairs in (found, expected))
        assert np.abs(np.diag(Phi.T @ (small_bar.M @ same))) == pytest.approx(np.ones(10), rel=1e-10)
    assert found.factor is not None
    assert f"{ranks} rank" in found.factor.solver
    loads = np.random.default_rng(0).standard_normal((len(small_bar.x), 3, 2))
    u = one.static_response(loads)
    assert spread.static_response(loads) == pytest.approx(u, abs=1e-8 * np.abs(u).max())


@installed
@two_ranks
def test_a_scene_takes_slepc_by_one_key() -> None:
    found, expected = (Pipeline(load_scene("beam-paper", keys), Cache(None)).modes for keys in (BAR, BAR[:1]))
    assert found.omega == pytest.approx(expected.omega, rel=1e-8)
    assert found.factor is not None
    assert "2 ranks" in found.factor.solver


@installed
def test_processes_and_files_end_with_the_factor(small_bar: FEModel) -> None:
    made = factorise_over_ranks(small_bar.K + 1e6 * small_bar.M, 1)
    ranks = made.solve.__self__  # type: ignore[attr-defined]
    process, folder = ranks._process, ranks._folder
    assert process.poll() is None
    del made, ranks
    assert process.poll() == 0
    assert not folder.exists()


@installed
def test_processes_that_end_too_soon_are_an_error(small_bar: FEModel) -> None:
    made = factorise_over_ranks(small_bar.K + 1e6 * small_bar.M, 1)
    made.solve.__self__._process.kill()  # type: ignore[attr-defined]
    with pytest.raises(AccuracyError, match=r'the processes of modes\.solver = "slepc" ended: '):
        made.solve(np.ones(small_bar.K.shape[0]))


def test_without_slepc_a_scene_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(slepc.PYTHON, raising=False)
    monkeypatch.setattr(slepc, "find_spec", lambda _: None)
    message = r"body\.beam\.modes\.solver = 'slepc': slepc4py is not installed: apt-get install python3-slepc4py"
    with pytest.raises(InputError, match=message):
        Pipeline(load_scene("beam-paper", BAR), Cache(None)).modes  # noqa: B018


def test_an_interpreter_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(slepc.PYTHON, "no-such-python")
    with pytest.raises(InputError, match="FMD_SLEPC_PYTHON = 'no-such-python' is no program"):
        Pipeline(load_scene("beam-paper", BAR), Cache(None)).modes  # noqa: B018


def test_mpiexec_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(slepc.PYTHON, "python3")
    monkeypatch.setattr(slepc.shutil, "which", lambda name: None if name == "mpiexec" else name)
    with pytest.raises(
        InputError, match=r"mpiexec is not installed: apt-get install openmpi-bin, or use modes.ranks = 1"
    ):
        Pipeline(load_scene("beam-paper", BAR), Cache(None)).modes  # noqa: B018


def test_ranks_belong_to_slepc() -> None:
    with pytest.raises(InputError, match=r"body\.beam\.modes\.ranks = 2: belongs to solver = 'slepc'"):
        load_scene("beam-paper", ["body.beam.modes.ranks=2"])
