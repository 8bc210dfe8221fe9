"""Cases of bodies in other programs' files: a thick beam is written, read again, and compared with closed forms."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from fmd.core.arrays import Array
from fmd.core.cache import Cache
from fmd.fem.formats.matrices import read_matrices
from fmd.output.formats import write_format
from fmd.reduction.equivalent_model import equivalent_model, modes_of
from fmd.reduction.formats.exudyn_file import read_exudyn
from fmd.reduction.formats.mbdyn_file import read_mbdyn
from fmd.reduction.formats.openfast_file import read_extptfm
from fmd.reduction.formats.sid_file import read_sid
from fmd.reduction.modal_data import ModalData
from fmd.verification.case import Figure, VerificationCase, make_figures, open_scene
from fmd.verification.closed_forms import timoshenko_free
from fmd.verification.frequencies import HUANG, STEEL

_LENGTH, _DEPTH, _WIDTH = 1.0, 0.1, 0.05
_MASS = STEEL.rho * _LENGTH * _DEPTH * _WIDTH
_INERTIA = _MASS * (_LENGTH**2 + _DEPTH**2) / 12  # about the centre, across the plane of bending
_TWO_ENDS = ('body.beam.marker={left={face="x-"}, right={face="x+"}}',)
_ONE_END = (*_TWO_ENDS, 'body.beam.modes={count=24, boundary="interface", interface=["left"]}')
_INTERFACE = (*_TWO_ENDS, 'body.beam.modes={count=24, boundary="interface"}')
_ROUND_OFF = 1e-9

MANUAL_EXAMPLE = """** RECORD GROUP 1, HEADER
**   REVISION,  NODE,  NORMAL, ATTACHMENT, CONSTRAINT, REJECTED MODES.
 REV0 3 2 0 0 0
** RECORD GROUP 2, FINITE ELEMENT NODE LIST
 1001 1002 1003
** RECORD GROUP 5, NODAL X COORDINATES
 0 0 0
** RECORD GROUP 6, NODAL Y COORDINATES
 -2. 0 2.
** RECORD GROUP 7, NODAL Z COORDINATES
 0 0 0
** RECORD GROUP 8, MODE SHAPES
** NORMAL MODE SHAPE # 1
 0 0 1 0 0 0
 0 0 0 0 0 0
 0 0 1 0 0 0
** NORMAL MODE SHAPE # 2
 1 0 0 0 0 0
 0 0 0 0 0 0
 1 0 0 0 0 0
** RECORD GROUP 9, MODAL MASS MATRIX
 2 0
 0 2
** RECORD GROUP 10, MODAL STIFFNESS MATRIX
 1 0
 0 1e2
** RECORD GROUP 11, DIAGONAL OF LUMPED MASS MATRIX
 1 1 1 1 1 1
 1 1 1 1 1 1
 1 1 1 1 1 1
"""
"""The dynamic example of MBDyn's input manual, whose inertia the manual states."""


def _reduced_beam(to: str, suffix: str, read: Callable[[Path], ModalData], cache: Cache | None) -> list[Figure]:
    """Compare a reduced beam's file: bending frequencies, mass, inertia about the centre of mass."""
    run = open_scene("verification/beam", cache, _TWO_ENDS)
    with TemporaryDirectory(prefix="fmd-") as folder:
        path = Path(folder) / f"beam{suffix}"
        write_format(run, to, "beam", path)
        data = read(path)
    hertz = modes_of(equivalent_model(data)).frequencies_hz
    inertia, centre = data.integrals.inertia(np.eye(1, 1 + data.n)[0]), data.integrals.S[:, 0] / data.integrals.mass
    about_centre = float(inertia[2, 2] - data.integrals.mass * (centre[:2] @ centre[:2]))
    return [
        *_bending(hertz),
        Figure("mass [kg]", data.integrals.mass, _MASS, _ROUND_OFF),
        Figure("moment of inertia [kg m²]", about_centre, _INERTIA, _ROUND_OFF),
    ]


def _bending(hertz: Array) -> list[Figure]:
    """Pair the free bending frequencies in the plane with the nearest ones found."""
    exact = timoshenko_free(_LENGTH, _DEPTH, STEEL, 2)
    ours = [float(hertz[np.abs(hertz - wanted).argmin()]) for wanted in exact]
    return make_figures([f"mode {k + 1} [Hz]" for k in range(len(exact))], ours, exact, 3e-3)


def _superelement(to: str, suffix: str, changes: tuple[str, ...], cache: Cache | None) -> list[Figure]:
    """Compare a superelement's file: bending frequencies of the free beam, and its mass as the interface feels it."""
    from scipy.io import loadmat
    from scipy.linalg import eigh

    run = open_scene("verification/beam", cache, changes)
    with TemporaryDirectory(prefix="fmd-") as folder:
        path = Path(folder) / f"beam{suffix}"
        write_format(run, to, "beam", path)
        element = loadmat(path) if to == "simscape" else read_extptfm(path)
    K, M = element["K"], element["M"]
    omega2 = eigh(K, M, eigvals_only=True)
    shift = np.zeros(len(K))
    shift[0 : len(K) - _modes_within(M) : 6] = 1.0  # all of the interface moves by 1 m along x
    figures = _bending(np.sqrt(np.maximum(omega2, 0.0)) / (2 * np.pi))
    return [*figures, Figure("mass [kg]", float(shift @ M @ shift), _MASS, 1e-7)]


def _modes_within(M: Array) -> int:
    """Number of fixed-interface modes of a superelement: the coordinates of unit mass, uncoupled with one another."""
    count = 0
    while np.array_equal(M[-count - 1 :, -count - 1 :], np.eye(count + 1)):
        count += 1
    return count


def _full(cache: Cache | None) -> list[Figure]:
    from fmd.reduction.eigen import FreeBodySolver
    from fmd.reduction.mode_families import lowest_modes

    run = open_scene("verification/beam", cache)
    with TemporaryDirectory(prefix="fmd-") as folder:
        path = Path(folder) / "beam.mtx"
        stiffness, mass, nodes, _ = write_format(run, "full", "beam", path)
        fe = read_matrices(stiffness, mass, nodes, (1.0, 1.0, 1.0))
    figures = _bending(lowest_modes(FreeBodySolver(fe), 6).frequencies_hz)
    return [*figures, Figure("mass [kg]", fe.mass, _MASS, _ROUND_OFF)]


def _manual(_: Cache | None) -> list[Figure]:
    with TemporaryDirectory(prefix="fmd-") as folder:
        path = Path(folder) / "manual.fem"
        path.write_text(MANUAL_EXAMPLE, encoding="utf-8")
        data = read_mbdyn(path)
    J = data.integrals.inertia(np.array([1.0, 0.0, 0.0]))
    figures = make_figures([f"J_{a}{a} [kg m²]" for a in "xyz"], J.diagonal(), (11.0, 3.0, 11.0), 1e-14)
    return [Figure("mass [kg]", data.integrals.mass, 3.0, 1e-14), *figures]


_BEAM = "thick beam, free, from its file for"
CASES = (
    VerificationCase("body-sid", f"{_BEAM} SID", HUANG, partial(_reduced_beam, "sid", ".SID_FEM", read_sid)),
    VerificationCase("body-mbdyn", f"{_BEAM} MBDyn", HUANG, partial(_reduced_beam, "mbdyn", ".fem", read_mbdyn)),
    VerificationCase("body-exudyn", f"{_BEAM} Exudyn", HUANG, partial(_reduced_beam, "exudyn", ".npz", read_exudyn)),
    VerificationCase(
        "body-simscape", f"{_BEAM} Simscape", HUANG, partial(_superelement, "simscape", ".mat", _INTERFACE)
    ),
    VerificationCase("body-openfast", f"{_BEAM} OpenFAST", HUANG, partial(_superelement, "openfast", ".dat", _ONE_END)),
    VerificationCase("body-full", "thick beam, free, from its full matrices", HUANG, _full),
    VerificationCase(
        "mbdyn-manual", "three nodes in MBDyn's manual", "MBDyn input manual, Modal Element Data", _manual
    ),
)
