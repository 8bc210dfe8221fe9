"""Measurements from universal, MAT and NetCDF files, shifts of clocks, and the scene's table of a fit."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

import fmd as package
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.netcdf import NetcdfVariable, write_netcdf
from fmd.fitting.experiment_files import read_experiments
from fmd.fitting.fit import fit_scene
from fmd.fitting.fit_model import FitModel
from fmd.fitting.measured_tables import read_table
from fmd.fitting.varied import read_shifts, read_varied
from tests.fitting.test_sensitivities import OSCILLATOR

PYUFF = Path(__file__).parent / "pyuff-2.5.8.uff"  # frequency responses, as that program writes them


def universal_text(kind: int, motion: int, functions: list[tuple[int, int, Array, Array]], force: int = 13) -> str:
    """Write functions (node, direction, abscissas, ordinates) as single precision at uneven abscissas."""
    lines = []
    for node, direction, x, y in functions:
        of = (5, 3) if kind == 4 else (0, 0)
        place = f"{kind:5d}{1:10d}{0:5d}{0:10d} {'NONE':10s}{node:10d}{direction:4d} {'NONE':10s}{of[0]:10d}{of[1]:4d}"
        ordinates = 5 if np.iscomplexobj(y) else 2
        size = f"{ordinates:10d}{len(x):10d}{0:10d}" + 3 * f"{0:13.5E}"
        kinds = [f"{number:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {'NONE':20s}" for number in (17, motion, force, 0)]
        rows = np.column_stack([x, y.real, y.imag] if ordinates == 5 else [x, y])
        numbers = [f"{number:13.5E}" for number in rows.ravel()]
        data = ["".join(numbers[k : k + 6]) for k in range(0, len(numbers), 6)]
        lines += ["    -1", "    58", *5 * ["NONE"], place, size, *kinds, *data, "    -1"]
    return "\n".join(lines) + "\n"


def test_responses_of_a_file_that_pyuff_wrote_are_read_with_the_sense_of_their_directions() -> None:
    file, header, columns = read_table(f"{PYUFF}; 1=plate.a; 12 = plate.b; 5=plate.e")
    assert file == str(PYUFF)
    names = ["plate.a.z.acceleration by plate.e.z", "plate.b.y.acceleration by plate.e.z"]
    parts = [f"{name} {part} [m/s^2/N]" for name in names for part in ("real", "imaginary")]
    assert header == ["frequency [Hz]", *parts]
    x = 10.0 + 0.5 * np.arange(7)
    first, second = (x**2 / (f**2 - x**2 + 0.5j * x) for f in (12.0, 13.0))  # what was written
    for column, expected in zip(columns, [x, first.real, first.imag, -second.real, -second.imag], strict=True):
        np.testing.assert_allclose(column, expected, atol=1e-11)


def test_histories_of_single_precision_are_read(tmp_path: Path) -> None:
    x = np.array([0.0, 0.1, 0.25, 0.3])
    path = tmp_path / "run.UNV"
    path.write_text(universal_text(1, 11, [(7, -1, x, np.sin(x)), (8, 3, x, np.cos(x))]))
    _, header, columns = read_table(f"{path}; 7=arm.tip")
    assert header == ["time [s]", "arm.tip.velocity.x [m/s]"]
    np.testing.assert_allclose(columns, [x, -np.sin(x)], rtol=1e-5)


X, RESPONSE = np.array([1.0, 2.0, 3.0]), np.array([1.0 + 1.0j, 2.0, 3.0])


@pytest.mark.parametrize(
    ("text", "places", "words"),
    [
        (universal_text(4, 12, [(1, 3, X, RESPONSE)]), "", "needs markers for its nodes 1, 5"),
        (universal_text(4, 12, [(1, 3, X, RESPONSE)]), "; 2=plate.a", "has no node 2; there are 1, 5"),
        (universal_text(4, 12, 2 * [(1, 3, X, RESPONSE)]), "; 1=plate.a; 5=plate.e", "twice"),
        (universal_text(4, 0, [(1, 3, X, RESPONSE)]), "; 1=plate.a; 5=plate.e", "type 0 in direction 3 at node 1"),
        (universal_text(4, 12, [(1, 3, X, RESPONSE)], 12), "; 1=plate.a; 5=plate.e", "those to forces are read"),
        (universal_text(4, 12, [(1, 3, X, X)]), "; 1=plate.a; 5=plate.e", "of real numbers at node 1, without phase"),
        (
            universal_text(1, 12, [(1, 3, X, X)]).replace(
                f"12{0:5d}{0:5d}{0:5d} {'NONE':20s} {'NONE':20s}", f"12{0:5d}{0:5d}{0:5d} {'NONE':20s} {'g':20s}"
            ),
            "; 1=plate.a",
            "values in 'g' at node 1; write them in m/s\\^2",
        ),
        (universal_text(2, 12, [(1, 3, X, X)]), "; 1=plate.a", "no time responses and no frequency responses"),
        (universal_text(1, 12, [(1, 3, X, X), (2, 3, 2.0 * X, X)]), "; 1=a; 2=b", "over several abscissas"),
        (universal_text(1, 12, [(1, 3, X, X)]) + universal_text(4, 12, [(2, 3, X, X)]), "; 1=a", "a file of its own"),
        (universal_text(1, 12, [(1, 3, X, X)])[:-8], "; 1=plate.a", "cut off"),
        (universal_text(1, 12, [(1, 3, X, X)]).replace("2.00000E+00", "", 1), "; 1=a", "number 1 isn't laid out"),
        (universal_text(1, 12, [(1, 3, X, X)]).replace("    58\n", "    58b     2\n"), "; 1=a", "write it as text"),
        (universal_text(1, 12, [(1, 3, X[::-1], X)]), "; 1=a", "must ascend"),
        ("    -1\n   164\n         3 feet\n    -1\n", "", "isn't in SI units"),
        ("time,x\n0,1\n", "", "isn't a universal file"),
    ],
)
def test_what_a_universal_file_lacks_is_told(text: str, places: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "test.uff"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        read_table(f"{path}{places}")


def test_mat_and_netcdf_files_hold_what_a_csv_file_does(tmp_path: Path) -> None:
    header, t = ["time [ms]", "slide.position [mm]", "slide.rate"], np.linspace(0.0, 400.0, 9)
    columns = [t, 10.0 * np.cos(0.02 * t), -0.2 * np.sin(0.02 * t)]
    np.savetxt(tmp_path / "a.csv", np.transpose(columns), "%.17g", ",", header=",".join(header), comments="")
    savemat(tmp_path / "a.mat", {"names": np.array(header, object), "data": np.transpose(columns)})
    names, units = ("time", "slide.position", "slide.rate"), ("ms", "mm", "")
    write_netcdf(
        tmp_path / "a.nc",
        [
            NetcdfVariable(name, ("time",), values, {"units": unit} if unit else {})
            for name, unit, values in zip(names, units, columns, strict=True)
        ],
    )
    for suffix in ("csv", "mat", "nc"):
        _, found, values = read_table(str(tmp_path / f"a.{suffix}"))
        assert found == header
        np.testing.assert_allclose(values, columns, rtol=1e-15)
    savemat(tmp_path / "b.mat", {"names": np.array(header[:2], object), "data": np.transpose(columns)})
    with pytest.raises(InputError, match=r"it has 2 names and data of shape \(9, 3\)"):
        read_table(str(tmp_path / "b.mat"))
    savemat(tmp_path / "c.mat", {"x": 1.0})
    (tmp_path / "d.mat").write_text("no MAT file")
    (tmp_path / "e.nc").write_text("no NetCDF file")
    for file, words in (("c.mat", "must hold 'names'"), ("d.mat", "no MAT file"), ("e.nc", "no NetCDF file")):
        with pytest.raises(InputError, match=words):
            read_table(str(tmp_path / file))
    for file in ("none.mat", "none.nc", "none.uff", "none.csv"):
        with pytest.raises(InputError, match="can't be read: No such file"):
            read_table(str(tmp_path / file))
    with pytest.raises(InputError, match="for universal files alone"):
        read_table(f"{tmp_path / 'a.csv'}; 1=plate.a")


LATE = 0.0037  # s


def write_late(path: Path, late: float, noise: float = 1e-4) -> str:
    """Write the oscillator's closed form by a clock that starts late, and what the same clock shows of its rate."""
    rng, t = np.random.default_rng(3), np.linspace(0.02, 0.45, 150)
    x = 0.01 * np.cos(20.0 * (t + late))
    v = -0.2 * np.sin(20.0 * (t + late))
    x, v = x + noise * rng.standard_normal(t.size), v + 20.0 * noise * rng.standard_normal(t.size)
    rows = "\n".join(f"{a:.12g},{b:.12g},{c:.12g}" for a, b, c in zip(t, x, v, strict=True))
    path.write_text(f"time [s],slide.position [m],slide.rate [m/s]\n{rows}\n")
    return str(path)


def test_a_clock_that_starts_late_is_found_with_the_stiffness(tmp_path: Path) -> None:
    start = package.load(OSCILLATOR, "joint.slide.spring=790 N/m").run
    sigmas = {"slide.position": 1e-4, "slide.rate": 2e-3}
    experiments = read_experiments([(start, write_late(tmp_path / "late.csv", LATE))], sigmas)
    names = [channel.name for channel in experiments[0].channels]
    varied = read_varied(start, ["joint.slide.spring"]) + read_shifts(["time=-5ms..20 ms"], names)
    fit = fit_scene(experiments, varied)
    (low, high), (early, late) = fit.intervals
    assert abs(fit.values[0] - 800.0) < 0.75 * (high - low)  # three standard deviations
    assert abs(fit.values[1] - LATE) < 0.75 * (late - early)
    assert late - early < 5e-4
    assert fit.warnings() == []
    alone = varied[:1] + read_shifts(["slide.rate=-5ms..5ms"], names)
    model = FitModel(experiments, alone)
    J, step = model.jacobian(np.array([0.01, 0.1]))[:, 1], 0.02
    low_r, high_r = (model.residuals(np.array([0.01, 0.1 + side * step])) for side in (-1.0, 1.0))
    np.testing.assert_allclose(J, (high_r - low_r) / (2.0 * step), atol=1e-3 * np.abs(J).max())
    assert not J[:150].any()  # of the other channel
    with pytest.raises(InputError, match="beyond the motion, which ends at"):  # at a bound, before anything is solved
        fit_scene(experiments, varied[:1] + read_shifts(["time=-5ms..0.1"], names))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("slide.positoin=-1..1", "did you mean 'slide.position'"),
        ("time=1 ms..2 ms", "two bounds around 0"),
        ("time", "must be two bounds"),
        ("time=-1 m..1 m", "must be in a unit of s"),
    ],
)
def test_a_wrong_shift_is_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_shifts([text], ["slide.position"])


def test_a_scene_says_what_it_is_fitted_to(fmd: Any, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    write_late(tmp_path / "late.csv", LATE)
    scene = tmp_path / "block.toml"
    scene.write_text(
        """
title = "Mass on a spring"
[body.block]
shape = "point"
mass = "2 kg"
marker = { hook = { at = ["0 m", "0 m", "0 m"] } }
[joint.slide]
type = "prismatic"
parent = "ground"
child = "block.hook"
axis = [1, 0, 0]
spring = "790 N/m"
position = "10 mm"
[simulation]
duration = "0.5 s"
output_step = "10 ms"
step = "0.2 ms"
tip = "block.hook"
[[simulation.run]]
integrator = "central-difference"
[fit]
vary = ["joint.slide.spring=500..1000"]
shift = ["time=-5 ms..20 ms"]
[[fit.experiment]]
file = "late.csv"
"""
    )
    assert fmd("fit", scene, "--out", tmp_path / "out", "--json") == 0
    spring, shift = json.loads(capsys.readouterr().out)["parameters"]
    assert spring["value"] == pytest.approx(800.0, rel=5e-3)
    assert (shift["key"], shift["unit"]) == ("shift of time", "s")
    assert shift["value"] == pytest.approx(LATE, abs=3e-4)
    text = (tmp_path / "out" / "fitted.toml").read_text()
    assert "shift of time: 0.003" in text
    again = package.load_scene(tmp_path / "out" / "fitted.toml")
    assert again.joint["slide"].spring == pytest.approx(spring["value"])
    assert again.fit is not None
    assert again.fit.experiment[0].file == "../late.csv"
    assert fmd("fit", scene, "--vary", "joint.slide.sprung") == 2
    assert "did you mean 'spring'" in capsys.readouterr().err
    assert fmd("fit", "arm", "--vary", "joint.elbow.spring") == 2
    assert "is missing: a file of measurements" in capsys.readouterr().err
