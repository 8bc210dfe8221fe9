"""FMUs of others in the loop: two oscillators, one of them an FMU, against the matrix exponential of both."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.dynamics.fmu_law import COUPLINGS
from fmd.output.fmu import build
from fmd.output.fmu.write import write_own_fmu
from fmd.output.formats import write_format
from fmd.stages.sampling_check import find_coarse_exchanges

pytest.importorskip("fmpy", reason="FMPy isn't installed")

# Two blocks of 2 kg and 1 kg on springs of 200 N/m and 150 N/m with dampers, and a spring of 80 N/m between them.
M, K, C = np.diag([2.0, 1.0]), np.array([[280.0, -80.0], [-80.0, 230.0]]), np.diag([3.0, 1.0])
START = np.array([0.05, -0.02, 0.0, 0.0])
DURATION = 0.64
BLOCK = """
title = "Block"
[body.block]
shape = "rigid"
mass = "{mass} kg"
inertia = ["1 kg m^2", "1 kg m^2", "1 kg m^2"]
marker = {{ centre = {{ at = ["0 m", "0 m", "0 m"] }} }}
[joint.slide]
type = "prismatic"
parent = "ground"
child = "block.centre"
axis = [1, 0, 0]
spring = "{spring} N/m"
damper = "{damper} N s/m"
position = "{start} m"
[drive.push]
type = "force"
joint = "slide"
{push}
[simulation]
duration = "0.64 s"
output_step = "0.16 s"
tip = "block.centre"
[[simulation.run]]
integrator = "runge-kutta"
tolerance = 1e-11
"""
COUPLED = """force = { formula = "80*other", unit = "N" }
[controller.other]
type = "fmu"
file = "other.fmu"
input = { "slide.force" = "80*slide.position" }
output = "slide.position"
sample_time = "20 ms"
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if build.own_target() is None:
        pytest.skip("this system has no FMU binaries")
    folder = tmp_path_factory.mktemp("fmus")
    (folder / "other.toml").write_text(
        BLOCK.format(mass=1, spring=230, damper=1, start=-0.02, push='force = "0 N"').replace("20 ms", "20 ms")
    )
    fmi2, _ = write_own_fmu(Pipeline(load_scene(folder / "other.toml")), folder / "other.fmu")
    with zipfile.ZipFile(fmi2) as archive:
        if not any(name.startswith("binaries/") for name in archive.namelist()):
            pytest.skip("no C compiler")
    path = folder / "first.toml"
    path.write_text(BLOCK.format(mass=2, spring=280, damper=3, start=0.05, push=COUPLED))
    return path


def exact() -> Array:
    """Return the first block's places at the output times."""
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    return np.array([(expm(A * t) @ START)[0] for t in np.linspace(0.0, DURATION, 5)])


def error(scene: Path, sample_time: float, *more: str) -> float:
    run = Pipeline(load_scene(scene, [f"controller.other.sample_time={sample_time!r} s", *more]))
    return float(np.abs(run.motion.joint_position("slide") - exact()).max())


@pytest.mark.parametrize(("coupling", "order"), COUPLINGS)
def test_two_oscillators_come_together_with_the_stated_order(scene: Path, coupling: str, order: int) -> None:
    given = (f"controller.other.coupling={coupling}", f"controller.other.order={order}")
    times = [0.02, 0.01, 0.005]
    errors = [error(scene, T, *given) for T in times]
    slope = np.polyfit(np.log(times), np.log(errors), 1)[0]
    assert slope == pytest.approx(order, abs=0.15)
    assert errors[-1] < (0.0005 if order == 2 else 0.005)


def test_fmi_3_gives_what_fmi_2_gives(scene: Path) -> None:
    file = "controller.other.file=other-fmi3.fmu"
    assert error(scene, 0.01, file) == pytest.approx(error(scene, 0.01), rel=1e-6)


def test_coarse_exchanges_are_warned_of_with_their_size(scene: Path) -> None:
    coarse = Pipeline(load_scene(scene, ["controller.other.sample_time=80 ms"]))
    (text,) = find_coarse_exchanges(coarse)
    assert text.startswith("other: the FMU's output changes by up to ")
    assert not find_coarse_exchanges(Pipeline(load_scene(scene, ["controller.other.sample_time=2.5 ms"])))


@pytest.mark.parametrize(
    ("override", "text"),
    [
        ("controller.other.file=none.fmu", "controller.other.file = 'none.fmu': can't be read"),
        ("controller.other.file=first.toml", "controller.other.file = 'first.toml': can't be read as an FMU"),
        ("controller.other.output=slide.positoin", "did you mean 'slide.position'?"),
        ("controller.other.input={'slide.forc' = 'slide.position'}", "did you mean 'slide.force'?"),
        ("controller.other.input={'slide.force' = 'slid.position'}", "slid"),
        ("controller.other.parameters={'slide.sprung' = 3.0}", "did you mean 'slide.spring'?"),
    ],
)
def test_what_an_fmu_lacks_is_refused(scene: Path, override: str, text: str) -> None:
    with pytest.raises(InputError) as fault:
        Pipeline(load_scene(scene, [override])).system  # noqa: B018
    assert text in str(fault.value)


@pytest.mark.parametrize("file", ["other.fmu", "other-fmi3.fmu"])
def test_an_export_does_not_write_over_a_controllers_fmu(scene: Path, file: str) -> None:
    """Neither by the name that is given nor by that of the second FMU beside it."""
    before = {path: path.read_bytes() for path in scene.parent.iterdir() if path.is_file()}
    run = Pipeline(load_scene(scene, [f"controller.other.file={file}"]))
    with pytest.raises(InputError, match=rf"{file}: is a file that the scene is read from; give another name"):
        write_format(run, "fmu", None, scene.parent / "other.fmu")
    assert {path: path.read_bytes() for path in scene.parent.iterdir() if path.is_file()} == before


def test_an_fmu_that_cannot_start_is_one_message_and_leaves_no_folder(
    scene: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with (
        zipfile.ZipFile(scene.parent / "other.fmu") as whole,
        zipfile.ZipFile(scene.parent / "torn.fmu", "w") as torn,
    ):
        for name in whole.namelist():
            torn.writestr(name, b"no program" if name.startswith("binaries/") else whole.read(name))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    before = Path.cwd()
    with pytest.raises(InputError, match=r"torn\.fmu.*: its FMU can't be started: "):
        Pipeline(load_scene(scene, ["controller.other.file=torn.fmu"])).motion  # noqa: B018
    assert not [*tmp_path.glob("fmd-fmu-*")]
    assert Path.cwd() == before
