"""``fmd export``: a body or the mechanism for another program."""

import json
import subprocess
import sys

import numpy as np
import pytest
import scipy.sparse as sp

from fmd.core.errors import InputError
from fmd.reduction.body_file import load_body
from fmd.reduction.equivalent_model import equivalent_model, modes_of
from fmd.reduction.formats.body_format import body_format
from fmd.reduction.formats.exudyn_file import read_exudyn
from fmd.reduction.formats.mbdyn_file import read_mbdyn
from fmd.reduction.formats.python_file import read_netcdf
from fmd.reduction.formats.sid_file import read_sid
from fmd.scene.outputs import BODY_FORMATS, EXPORT_FORMATS, MECHANISM_FORMATS, Export

PART = """title = "part"
[body.a]
shape = "bar"
length = "200 mm"
depth = "20 mm"
width = "10 mm"
E = "210 GPa"
nu = 0.3
rho = "7800 kg/m^3"
mesh = { divisions = [6, 1, 1] }
modes = { count = 4 }
marker = { root = { face = "x-" } }
"""
FEW = ("--set", "body.beam.mesh.divisions=[8,1,1]")


def test_every_format_has_a_name_a_suffix_and_a_file():
    assert set(EXPORT_FORMATS) > set(MECHANISM_FORMATS)
    assert all(callable(body_format(name).write) for name in BODY_FORMATS)
    with pytest.raises(InputError, match=f"must be {', '.join(map(repr, [*EXPORT_FORMATS][:-1]))} or 'fmu'"):
        Export(file="beam.nc", body="beam", format="none")


def test_a_body_is_written_for_python(fmd, tmp_path, capsys):
    path = tmp_path / "new" / "arm.nc"
    assert fmd("export", "beam-paper", "--to", "python", "--out", path, "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"format": "python", "files": [str(path)]}
    assert len(load_body(path).body.omega) == 5
    assert b"not stated: shapes and matrices are input of other runs" in path.read_bytes()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("beam", "--to", "pyton"), "--to = 'pyton': no such format; there are"),
        (("beam", "--to", "python", "--body", "bim"), "no such flexible body; there are beam"),
        (("beam", "--to", "python", "--out", "x.msh"), "a file of format python ends in .nc"),
    ],
)
def test_wrong_options_get_one_message(fmd, options, message, capsys):
    assert fmd("export", *options) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert message in error


@pytest.mark.parametrize(
    ("to", "file", "others"),
    [
        ("sid", "beam.SID_FEM", []),
        ("mbdyn", "beam.fem", []),
        ("exudyn", "beam.npz", ["beam.py"]),
        ("simscape", "beam.mat", []),
        ("full", "beam.mtx", ["beam-mass.mtx", "beam-nodes.csv", "beam-modes.npz"]),
    ],
)
def test_a_body_is_written_for_every_program(fmd, tmp_path, capsys, to, file, others):
    assert fmd("export", "beam", "--to", to, "--out", tmp_path / file, "--json", *FEW) == 0
    names = [file, *others]
    assert json.loads(capsys.readouterr().out) == {"format": to, "files": [str(tmp_path / name) for name in names]}
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    for name in names:
        assert str(tmp_path).encode() not in (tmp_path / name).read_bytes()


@pytest.mark.parametrize(("to", "file", "read"), [("python", "a.nc", read_netcdf), ("exudyn", "a.npz", read_exudyn)])
def test_a_part_without_a_joint_is_written_with_its_stress_and_again(fmd, tmp_path, to, file, read):
    (tmp_path / "part.toml").write_text(PART)
    assert fmd("export", tmp_path / "part.toml", "--to", to, "--out", tmp_path / file) == 0
    first = read(tmp_path / file)
    (tmp_path / "back.toml").write_text(
        f'title = "b"\n[body.a]\nbody = {{ file = "{file}" }}\nmarker = {{ root = {{ node = "root" }} }}\n'
    )
    assert fmd("export", tmp_path / "back.toml", "--to", to, "--out", tmp_path / f"2{file}") == 0
    again = read(tmp_path / f"2{file}")
    assert np.abs(first.integrals.S[:, 1:]).max() < 1e-6  # in mean axes
    assert np.diag(again.K) == pytest.approx(np.diag(first.K), rel=1e-9)
    assert np.abs(np.abs(again.stress) - np.abs(first.stress)).max() < 1e-8 * np.abs(first.stress).max()


def test_openfast_takes_the_marker_that_is_named(fmd, tmp_path, capsys):
    out = ("--out", tmp_path / "beam.dat", *FEW)
    assert fmd("export", "beam", "--to", "openfast", *out) == 2
    assert "OpenFAST's platform has one interface, and the body 2 markers; name one" in capsys.readouterr().err
    named = 'body.beam.modes={count=3, boundary="interface", interface=["tip"]}'
    assert fmd("export", "beam", "--to", "openfast", *out, "--set", named) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["beam.dat", "beam_ExtPtfm.dat"]


@pytest.mark.parametrize("suffix", [".mtx", ".npz", ".txt"])
def test_full_matrices_are_read_by_a_scene_of_matrices(fmd, tmp_path, capsys, suffix):
    assert fmd("export", "beam", "--to", "full", "--out", tmp_path / f"beam{suffix}", *FEW) == 0
    (tmp_path / "back.toml").write_text(
        f"""title = "back"
[body.beam]
matrices = {{ stiffness = "beam{suffix}", mass = "beam-mass{suffix}", nodes = "beam-nodes.csv", unit = "m" }}
modes = {{ count = 4 }}
marker = {{ root = {{ plane = "x = 0" }} }}
"""
    )
    capsys.readouterr()
    assert fmd("modes", tmp_path / "back.toml", "--json") == 0
    found = json.loads(capsys.readouterr().out)["frequencies_hz"]
    assert fmd("modes", "beam", "--json", *FEW, "--set", "body.beam.modes={count=4}") == 0
    assert found == pytest.approx(json.loads(capsys.readouterr().out)["frequencies_hz"], rel=1e-8)


def test_a_scene_writes_bodies_among_its_outputs(fmd, tmp_path):
    output = 'output=[{type="export", format="sid", file="beam.SID_FEM", body="beam"}]'
    quick = ("--set", 'simulation.run=[{integrator="auto"}]', "--set", "simulation.duration=1ms", "--no-budget")
    assert fmd("run", "beam-paper", "--out", tmp_path, "--set", output, *FEW, *quick, "--no-pictures") == 0
    assert read_sid(tmp_path / "beam.SID_FEM").n == 5


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_the_script_for_exudyn_runs(fmd, tmp_path, capsys):
    pytest.importorskip("exudyn")
    assert fmd("export", "beam", "--to", "exudyn", "--out", tmp_path / "beam.npz", *FEW) == 0
    done = subprocess.run([sys.executable, "beam.py"], cwd=tmp_path, capture_output=True, text=True, check=True)
    place = np.array(done.stdout.strip().splitlines()[-1].partition("]:")[2].split(), dtype=float)
    # A uniform bar of length l on a ball joint: θ̈ = −3 g cos θ / 2 l; the tip's fall by series in t.
    g, length, t = 9.81, 0.34, 0.1
    angle = 0.75 * g / length * t**2 * (1 - 0.0125 * (1.5 * g / length) ** 2 * t**4)
    assert place[:2] == pytest.approx([length * np.cos(angle), -length * np.sin(angle)], abs=5e-3)


def test_a_reduced_body_has_no_matrices_to_write(fmd, tmp_path, capsys):
    assert fmd("export", "beam", "--to", "mbdyn", "--out", tmp_path / "beam.fem", *FEW) == 0
    scene = tmp_path / "back.toml"
    scene.write_text('title = "back"\n[body.beam]\nbody = { file = "beam.fem" }\nmarker = { a = { node = "tip" } }\n')
    capsys.readouterr()
    for to, what in (("full", "has no full matrices"), ("simscape", "without the matrices that a superelement")):
        assert fmd("export", scene, "--to", to) == 2
        error = capsys.readouterr().err
        assert what in error
        assert error.count("\n") == 1
    assert fmd("export", scene, "--to", "sid", "--out", tmp_path / "again.SID_FEM") == 0
    first, again = read_mbdyn(tmp_path / "beam.fem"), read_sid(tmp_path / "again.SID_FEM")
    assert again.integrals.mass == pytest.approx(first.integrals.mass, rel=1e-12)
    assert np.diag(again.K) == pytest.approx(modes_of(equivalent_model(first)).omega ** 2, rel=1e-9)
    assert fmd("mesh", scene) == 2
    assert "is given by its file: without elements" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_exudyn_takes_the_full_matrices(fmd, tmp_path, capsys):
    FEM = pytest.importorskip("exudyn.FEM")
    assert fmd("export", "beam", "--to", "full", "--out", tmp_path / "beam.npz", *FEW) == 0
    fem = FEM.FEMinterface()
    fem.nodes = {"Position": np.loadtxt(tmp_path / "beam-nodes.csv", delimiter=",", skiprows=1)[:, 1:]}
    fem.stiffnessMatrix = sp.csr_matrix(sp.load_npz(tmp_path / "beam.npz"))
    fem.massMatrix = sp.csr_matrix(sp.load_npz(tmp_path / "beam-mass.npz"))
    fem.ComputeEigenmodes(nModes=6, excludeRigidBodyModes=6, useSparseSolver=True)
    capsys.readouterr()
    assert fmd("modes", "beam", "--json", *FEW, "--set", "body.beam.modes={count=6}") == 0
    ours = json.loads(capsys.readouterr().out)["frequencies_hz"]
    assert fem.GetEigenFrequenciesHz() == pytest.approx(ours, rel=1e-6)
