"""What a command doesn't need it doesn't load: each runs in a process of its own that lists its modules."""

import json
import subprocess
import sys
from functools import partial

import pytest

pytestmark = pytest.mark.slow

LISTING = """
import json, sys
from fmd.cli.app import main
try:
    main()
except SystemExit as stop:
    assert not stop.code
print("\\n" + json.dumps(sorted({name.partition(".")[0] for name in sys.modules} | {
    ".".join(name.split(".")[:2]) for name in sys.modules if name.startswith("scipy.")} | {
    name for name in sys.modules if name.startswith("fmd.")})))
"""
QUICK = ["--set", "body.beam.mesh.divisions=[12, 1, 1]", "--set", "simulation.duration=50 ms"]
QUICK += ["--set", "body.beam.element={root={at=['20 mm', '0 mm', '0 mm']}}"]
FILM = '{type="film", file="motion.mp4", body="beam", frames=2, rate=20.0, size=[320, 180]}'
DRAWN = ["--set", f'output=[{{type="chart", file="centre.png", quantity="centre_of_mass"}}, {FILM}]']


@pytest.fixture(scope="module")
def environment(with_own_cache, tmp_path_factory):
    return with_own_cache(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="module")
def modules(environment):
    """Call for the names of the modules that a command has loaded in the end."""
    return partial(_modules, environment)


def _modules(environment, *arguments):
    command = [sys.executable, "-c", LISTING, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300, env=environment)
    assert done.returncode == 0, done.stderr
    return set(json.loads(done.stdout.splitlines()[-1]))


@pytest.fixture(scope="module")
def cold_run(modules, tmp_path_factory):
    folder = tmp_path_factory.mktemp("cold")
    loaded = modules("run", "beam", *QUICK, *DRAWN, "--out", str(folder))
    assert {"motion.mp4", "centre.png"} <= {path.name for path in folder.iterdir()}
    return loaded


def test_help_loads_nothing_heavy(modules):
    heavy = {
        "numpy",
        "scipy",
        "pydantic",
        "pint",
        "llvmlite",
        "gmsh",
        "skfem",
        "pyvista",
        "matplotlib",
        "xarray",
        "joblib",
    }
    assert not modules("--help") & heavy


def test_modes_load_neither_pictures_nor_integrators(modules):
    loaded = modules("modes", "beam", *QUICK, "--no-cache")
    assert "skfem" in loaded
    assert not loaded & {"pyvista", "matplotlib", "llvmlite", "xarray", "fmd.integrators", "fmd.dynamics"}


def test_a_run_draws_in_another_process(cold_run):
    assert "llvmlite" in cold_run
    assert not cold_run & {"pyvista", "vtk", "vtkmodules", "matplotlib", "imageio"}


@pytest.mark.usefixtures("cold_run")
def test_modes_of_a_scene_that_was_run_load_little_more_than_numpy(modules):
    loaded = modules("modes", "beam", *QUICK)
    assert "numpy" in loaded
    meshing = {"gmsh", "fmd.meshes", "skfem", "meshio", "fmd.fem.model", "fmd.fem.assembly"}
    assert not loaded & {*meshing, "pint", "dask", "llvmlite", "pyvista", "matplotlib", "xarray", "fmd.integrators"}
    assert not loaded & {"scipy", "joblib"}


@pytest.mark.usefixtures("cold_run")
def test_a_second_run_loads_little_but_numpy_and_the_kernels(modules, tmp_path):
    warm = modules("run", "beam", *QUICK, "--no-pictures", "--out", str(tmp_path))
    assert (tmp_path / "motion.nc").exists()
    assert not warm & {"gmsh", "fmd.meshes", "skfem", "meshio", "pyvista", "matplotlib"}
    assert not warm & {"xarray", "pandas", "dask", "distributed", "joblib", "pint"}
    assert not warm & {f"scipy.{name}" for name in ("linalg", "sparse", "optimize", "spatial", "io", "interpolate")}
    tracing = {"fmd.dynamics.compiler.programs", "fmd.dynamics.compiler.llvm", "fmd.kernels.translate"}
    assert not warm & {*tracing, "fmd.stages.part_results"}


def test_the_package_itself_loads_nothing_heavy():
    listing = "import sys, fmd; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", listing], capture_output=True, text=True, check=True, timeout=60)
    assert not set(done.stdout.split()) & {"numpy", "scipy", "pydantic", "gmsh", "skfem", "pyvista", "llvmlite"}


def test_a_rigid_scene_loads_neither_gmsh_nor_scikit_fem(modules, tmp_path):
    loaded = modules("run", "rod-slider", "--no-pictures", "--set", "simulation.duration=1 s", "--out", str(tmp_path))
    assert "llvmlite" in loaded
    assert not loaded & {"gmsh", "fmd.meshes", "skfem", "meshio", "fmd.fem.model", "pyvista", "matplotlib"}


def test_a_sweeps_tables_are_written_without_xarray(tmp_path):
    code = f"""
import sys
from pathlib import Path
from fmd.sweep.points import Point, Variation
from fmd.sweep.record import Record
from fmd.sweep.study import Sweep
from fmd.sweep.table import SweepTable, write_tables
points = tuple(Point((force,), None, "key") for force in ("1 N", "2 N"))
records = (Record("ok", summary={{"tip_m": 1.0}}),) * 2
write_tables(SweepTable(Sweep((Variation("force", ("1 N", "2 N")),), points, records, 2)), Path({str(tmp_path)!r}))
print({{"xarray", "pandas"}} & {{*sys.modules}})
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["set()"]
    assert (tmp_path / "sweep.nc").is_file()


def test_a_scene_makes_checks_of_those_kinds_of_tables_alone_that_it_has():
    code = """
from fmd import load_scene
from fmd.scene.any_body import Bar, Propeller
load_scene("beam")
print(Bar.__pydantic_complete__, Propeller.__pydantic_complete__)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "False"]
