"""A cache folder for the test session, small meshes and models, formulas of beam theory."""

import gc
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib import import_module
from itertools import permutations
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

_CACHE = Path(tempfile.mkdtemp(prefix="fmd-tests-"))
# Processes share the cores: threads of their small products would wait for each other, and 70 times as long.
os.environ.setdefault("OMP_NUM_THREADS", "1")
# Bytecode is kept, that of tests with rewritten asserts, too: some hundred processes would each make it anew.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# Kernels are shared by the processes of a run, and stay from run to run, named by their source.
_KEPT = Path(__file__).parents[1] / ".pytest_cache" / "kernels"
_KERNELS = Path(os.environ.setdefault("FMD_TEST_KERNELS", str(_KEPT)))
_KERNELS.mkdir(parents=True, exist_ok=True)


def _with_own_cache(folder: Path) -> dict[str, str]:
    (folder / "kernels").symlink_to(_KERNELS.resolve(), target_is_directory=True)
    return os.environ | {"FMD_CACHE": str(folder)}


# The cache folder is read as soon as fmd.dynamics is imported, so it has to be set before that.
os.environ.update(_with_own_cache(_CACHE))

import jsonschema
import numpy as np
import pytest
from _pytest.runner import runtestprotocol
from hypothesis import settings
from hypothesis.internal.conjecture import providers
from scipy.integrate import simpson
from scipy.linalg import expm
from scipy.optimize import brentq

from fmd.core.arrays import Array
from fmd.core.limits.memory import ALLOCATIONS
from fmd.core.paths import kernel_folder
from fmd.core.processes import ChildError
from fmd.dynamics.compiler import store
from fmd.fem.assembly import assemble
from fmd.fem.formats import meshio_reader
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.kernels import kernel
from fmd.kernels.machine import compile_object
from fmd.meshes.bar import hexahedral_bar
from fmd.output.picture_files import DrawingProcess
from fmd.render.calls import draw_here
from fmd.stages import visual_files
from fmd.stages.meshing import cad_files

gc.set_threshold(5 * ALLOCATIONS)  # tests build as many objects as the command does, beside what the process keeps
# Examples are of what Hypothesis knows, not of all numbers in whatever modules are loaded: reading these takes each
# process three seconds, and a test would have other examples alone than beside others.
providers._get_local_constants = lambda: providers._local_constants
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

STEEL = Material(E=210e9, nu=0.3, rho=7800.0)
Sizes = tuple[float, float, float]
Divisions = tuple[int, int, int]


class Element(NamedTuple):
    """An element by name, the cells it lives on and its order."""

    name: str
    cell_type: str
    order: int


ELEMENTS = (
    Element("hex8", "hexahedron", 1),
    Element("hex20", "hexahedron", 2),
    Element("tet4", "tetra", 1),
    Element("tet10", "tetra", 2),
)


class Lanes(NamedTuple):
    """Calls of the kernel that marches in lanes: how many marches and groups of eight each had."""

    marches: list[int]
    groups: list[int]


@pytest.fixture
def lanes(monkeypatch: pytest.MonkeyPatch) -> Lanes:
    """March in lanes however few the steps are, and note the calls."""
    from fmd.integrators import central_difference

    found, march = Lanes([], []), central_difference.march_lanes

    def march_noted(steps: Any, samples: Any, starts: Any, rows: Any, n_steps: int) -> None:
        found.marches.append(len(starts.values))
        found.groups.append(len(rows))
        march(steps, samples, starts, rows, n_steps)

    monkeypatch.setattr(central_difference, "LANE_STEPS", 1)
    monkeypatch.setattr(central_difference, "march_lanes", march_noted)
    return found


@pytest.fixture(scope="session")
def with_own_cache() -> Callable[[Path], dict[str, str]]:
    """Call for the environment of a process with a cache of its own in a folder, that has the kernels of this run."""
    return _with_own_cache


QUICKLY_COMPILED = {
    *("contact", "dynamics", "fitting", "integrators", "responses", "stability", "stages"),
    # a function of its own for each scene, which is hardly marched
    *("test_body_file", "test_coarse_mesh", "test_constant_velocity", "test_corner_stress", "test_deformation"),
    *("test_errors", "test_estimators", "test_exudyn", "test_lanes", "test_loops", "test_random_mechanisms"),
    *("test_rigid_bodies", "test_details", "test_histories", "test_large_deflection", "test_loads_through_bodies"),
    *("test_mechanism_view", "test_middle_stress", "test_overstated", "test_pieces_stability", "test_pressure"),
    *("test_propeller_scenes", "test_spin_up", "test_stress", "test_stretched_bars", "test_suite", "test_truth"),
    *("test_turning_pieces", "test_urdf", "test_view_page", "test_work", "test_work_precision"),
}
"""Rooms and files whose marches are short; longer ones cost more than compiling."""
FULLY_COMPILED = {"test_machine_code"}
"""Files of theirs that compile as users do."""


@pytest.fixture(scope="module", autouse=True)
def least_effort(request: pytest.FixtureRequest) -> Iterator[None]:
    """Compile what some rooms and files march a few hundred steps with LLVM's least effort, beside what users march.

    It takes a tenth of the time, which is half of all that there is. All else, processes of their own and
    `load_code` compile as users do.
    """
    names = {*request.path.parts, request.path.stem}
    if not names & QUICKLY_COMPILED or names & FULLY_COMPILED:
        yield
        return
    entered: list[kernel.Kernel] = []

    def enter(own: kernel.Kernel, *arguments: Any, enter: Any = kernel.Kernel._enter) -> Any:
        entered.append(own)
        return enter(own, *arguments)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kernel.Kernel, "_enter", enter)
        for module in (kernel, store):
            patch.setattr(module, "compile_object", lambda text, *_, **__: compile_object(text, effort=0))
            patch.setattr(module, "kernel_folder", _folder_of_quick_kernels)
        yield
    for own in entered:
        own._entries.clear()


OWN_PROCESSES = {"test_drawing_process", "test_import_mesh", "test_mesh_fuzz", "test_processes"}
"""Files whose runs start all processes that those of users do."""


@pytest.fixture(scope="module", autouse=True)
def in_this_process(request: pytest.FixtureRequest) -> Iterator[None]:
    """Read CAD files and meshes here, and draw here, which has the libraries that a process would load each time.

    Some 250 of them start in a run of all tests; most take a third of their time to begin, those that draw a whole
    second.
    """
    with pytest.MonkeyPatch.context() as patch:
        if request.path.stem not in OWN_PROCESSES:
            for module in (cad_files, meshio_reader, visual_files):
                patch.setattr(module, "run_child", _call_here)
            patch.setattr(DrawingProcess, "start", lambda _: None)
            patch.setattr(
                DrawingProcess, "__call__", lambda _, *arguments, **settings: draw_here(*arguments, **settings)
            )
        yield


def _call_here(target: str, *arguments: str, **_: Any) -> str:
    module, _, function = target.partition(":")
    if said := getattr(import_module(module), function)([*arguments]):
        raise ChildError(said)
    return ""


def _folder_of_quick_kernels() -> Path:
    folder = kernel_folder() / "quick"
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def fmd() -> Callable[..., int]:
    """Run the command line in this process; it answers with its exit status. JSON is held against its schema."""
    from fmd.cli import options
    from fmd.cli.answers import answer_schema
    from fmd.cli.app import main
    from fmd.core.files import require_finite

    def call(*arguments: object) -> int:
        command, *_ = given = [str(argument) for argument in arguments]

        def check(answer: object) -> None:
            require_finite(answer)
            faults = jsonschema.Draft202012Validator(answer_schema(command)).iter_errors(json.loads(json.dumps(answer)))
            assert [f"{fault.json_path}: {fault.message[-200:]}" for fault in faults] == []

        try:
            with mock.patch.object(options, "require_finite", check):
                main(given)
        except SystemExit as stop:
            return int(stop.code or 0)
        return 0

    return call


def pytest_collection(session: pytest.Session) -> None:
    """Import files from the last one on in every second process of a run of all.

    Where asserts aren't rewritten yet, each then does half of them, and reads the others'.
    """
    folder = Path(__file__).parent
    if session.config.args != [folder.name] or int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:]) % 2 == 0:
        return
    for path in sorted(folder.rglob("test_*.py"), reverse=True):
        with suppress(Exception, pytest.skip.Exception):  # collecting says it again
            import_module(".".join(path.relative_to(folder.parent).with_suffix("").parts))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.get_closest_marker("long"):
            item.add_marker("slow")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Send one report of a test that passed to the process that counts them: five messages take longer than many."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return None
    duration = 0.0
    for report in runtestprotocol(item, log=False, nextitem=nextitem):
        duration += report.duration
        if report.when == "call" or not report.passed:
            report.duration = duration
            item.ihook.pytest_runtest_logreport(report=report)
    return True


def pytest_collection_finish() -> None:
    gc.freeze()  # what was collected stays to the end


def pytest_unconfigure() -> None:
    shutil.rmtree(_CACHE, ignore_errors=True)


def make_box(
    cell_type: str, divisions: Divisions, sizes: Sizes = (1.0, 1.0, 1.0), distortion: float = 0.0, seed: int = 0
) -> SolidMesh:
    """Grid a box with a corner at the origin; its inner points are moved by up to ``distortion`` of a cell."""
    axes = [np.arange(n + 1) for n in divisions]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inner = ((grid > 0) & (grid < divisions)).all(axis=1)
    moved = grid + inner[:, None] * np.random.default_rng(seed).uniform(-distortion, distortion, grid.shape)
    stride = np.array([(divisions[1] + 1) * (divisions[2] + 1), divisions[2] + 1, 1])
    first = grid[(grid < divisions).all(axis=1)] @ stride
    if cell_type == "hexahedron":
        corners = [np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])]
    else:  # Kuhn's six tetrahedra, each along one way from a cube's corner to the opposite one
        corners = []
        for order in permutations(range(3)):
            way = np.cumsum(np.eye(3, dtype=int)[[*order]], axis=0)
            corners.append(np.array([[0, 0, 0], *(way if np.linalg.det(way) > 0 else way[[1, 0, 2]])]))
    cells = np.concatenate([first[:, None] + corner @ stride for corner in corners])
    faces = {
        name + sign: np.flatnonzero(grid[:, a] == end)
        for a, name in enumerate("xyz")
        for sign, end in (("-", 0), ("+", divisions[a]))
    }
    points = moved * (np.array(sizes) / divisions)
    return SolidMesh(points, cells, cell_type, {"box": np.arange(len(cells))}, faces)


class TimoshenkoBeam(NamedTuple):
    """Timoshenko's beam of rectangular section, with Cowper's shear factor (J Appl Mech 33, 1966).

    With s = x/L and the state (w/L, ψ, M L/EI, Q L²/EI) it is a linear system y' = S(ω) y.
    """

    length: float
    depth: float
    width: float
    material: Material

    @property
    def mass(self) -> float:
        return self.material.rho * self.length * self.depth * self.width

    @property
    def bending(self) -> float:
        return self.material.E * self.width * self.depth**3 / 12

    def system(self, omega: float) -> Array:
        """Return S, shape (4, 4)."""
        nu, length = self.material.nu, self.length
        shear = 10 * (1 + nu) / (12 + 11 * nu) * self.material.E / (2 * (1 + nu)) * self.depth * self.width
        inertia = self.mass * length * omega**2 / self.bending
        S = np.zeros((4, 4))
        S[0, 1], S[0, 3] = 1.0, self.bending / (shear * length**2)
        S[1, 2] = 1.0
        S[2, 1], S[2, 3] = -inertia * self.depth**2 / 12, -1.0
        S[3, 0] = -inertia * length**2
        return S

    def frequencies_hz(self, count: int, pinned: bool = False) -> Array:
        """Bending frequencies [Hz], free at x = L and free or pinned at x = 0: zeros of a determinant of exp(S)."""
        start = [1, 3] if pinned else [0, 1]  # what may be non-zero at x = 0

        def determinant(omega: float) -> float:
            return float(np.linalg.det(expm(self.system(omega))[2:, start]))

        scale = np.sqrt(self.bending / (self.mass * self.length**3))
        trial = scale * np.linspace(1.0, (np.pi * (count + 1)) ** 2, 100 * (count + 1))
        sign = np.sign([determinant(omega) for omega in trial])
        roots = [brentq(determinant, trial[k], trial[k + 1]) for k in np.flatnonzero(np.diff(sign))]
        return np.array(roots[:count]) / (2 * np.pi)

    def end_mobilities(self, count: int) -> Array:
        """Square of each free mode's displacement at x = 0 for unit modal mass [1/kg]."""
        squares, n = [], 1000
        for omega in 2 * np.pi * self.frequencies_hz(count):
            S = self.system(omega)
            step, (w0, psi0) = expm(S / n), np.linalg.svd(expm(S)[2:, :2])[2][1]
            y = [np.array([w0, psi0, 0.0, 0.0])]
            for _ in range(n):
                y.append(step @ y[-1])
            w, psi = np.array(y).T[:2]
            modal_mass = self.mass * simpson((self.length * w) ** 2 + (self.depth * psi) ** 2 / 12, dx=1 / n)
            squares.append((self.length * w0) ** 2 / modal_mass)
        return np.array(squares)


@pytest.fixture(scope="session", params=ELEMENTS, ids=lambda element: element.name)
def element(request: pytest.FixtureRequest) -> Element:
    """Each element in turn; a test that takes only some parametrises it, ``indirect``."""
    return Element(*request.param)


@pytest.fixture(scope="session")
def steel() -> Material:
    return STEEL


@pytest.fixture(scope="session")
def box_mesh() -> Callable[..., SolidMesh]:
    return make_box


@pytest.fixture(scope="session")
def timoshenko() -> Callable[..., TimoshenkoBeam]:
    return TimoshenkoBeam


@pytest.fixture(scope="session")
def distorted(element: Element) -> FEModel:
    """A box of 1.2 × 1 × 0.8 m of each element, its inner points moved at random."""
    return assemble(make_box(element.cell_type, (3, 3, 3), (1.2, 1.0, 0.8), 0.2), element.order, STEEL)


@pytest.fixture(scope="session")
def small_bar() -> FEModel:
    """A bar of 300 × 40 × 20 mm, of 7 × 2 × 1 quadratic hexahedra: small enough for dense solutions."""
    return assemble(SolidMesh(*hexahedral_bar(0.3, 0.04, 0.02, (7, 2, 1))), 2, STEEL)
