"""Damaged files: whatever happens to a mesh, CAD or matrix file, reading it ends in a mesh or in one message.

Readers of text run as they are. What meshio and Gmsh read goes through the function that the product runs in a process
of its own, here in a fork, with the same limit on memory and a time after which it counts as given up.
"""

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmd.core.errors import AccuracyError, InputError
from fmd.fem.assembly import assemble
from fmd.fem.formats import meshio_reader
from fmd.fem.formats.abaqus import read_abaqus
from fmd.fem.formats.import_mesh import solid_mesh
from fmd.fem.formats.matrices import read_matrices
from fmd.fem.formats.nastran import read_nastran
from fmd.fem.formats.raw_mesh import MeshFileError, RawMesh
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.meshes.bar import hexahedral_bar
from fmd.meshes.gmsh_session import gmsh_model

TEXT = {"inp": read_abaqus, "bdf": read_nastran}
OTHER = ("v2.msh", "v4.msh", "v2b.msh", "v4b.msh", "vtk", "med", "vtu")
SECONDS = 5.0


@pytest.fixture(scope="module")
def originals(tmp_path_factory) -> Path:
    """A box of few tetrahedra of second order with names, in every format."""
    import pyvista

    folder = tmp_path_factory.mktemp("whole")
    with gmsh_model("box") as gmsh:
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMin", 1.0)
        gmsh.option.setNumber("Mesh.ElementOrder", 2)
        gmsh.model.addPhysicalGroup(3, [1], name="block")
        gmsh.model.addPhysicalGroup(2, [1], name="left")
        gmsh.model.mesh.generate(3)
        for form in ("inp", "bdf", *OTHER[:-1]):
            gmsh.option.setNumber("Mesh.MshFileVersion", 2.2 if form.startswith("v2") else 4.1)
            gmsh.option.setNumber("Mesh.Binary", form in ("v2b.msh", "v4b.msh"))
            gmsh.write(str(folder / f"box.{form}"))
        gmsh.write(str(folder / "box.step"))
    pyvista.read(folder / "box.vtk").save(folder / "box.vtu")
    return folder


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """Cut it off, flip bits, shuffle, drop or repeat lines, put a senseless number in, or several of these."""
    for _ in range(rng.integers(1, 4)):
        data, lines = bytearray(content), content.split(b"\n")
        place = int(rng.integers(len(data))) if data else 0
        match rng.integers(8):
            case 0:
                content = content[:place]
            case 1:
                for k in rng.integers(len(data), size=rng.integers(1, 20)) if data else ():
                    data[k] ^= 1 << int(rng.integers(8))
                content = bytes(data)
            case 2:
                rng.shuffle(lines)
                content = b"\n".join(lines)
            case 3:
                content = b"\n".join(line for line in lines if rng.random() > 0.05)
            case 4:
                content = b"\n".join([*lines, *lines[len(lines) // 2 :]])
            case 5:
                content = content[:place] + content[place + int(rng.integers(50)) :]
            case 6:
                row = int(rng.integers(len(lines)))
                words = lines[row].split()
                if words:
                    words[int(rng.integers(len(words)))] = [b"1000000000000", b"-1", b"nan", b"1e400", b"*", b""][
                        int(rng.integers(6))
                    ]
                    lines[row] = b" ".join(words)
                content = b"\n".join(lines)
            case 7:
                content = content[:place] + rng.bytes(int(rng.integers(1, 200))) + content[place:]
    return content


def outcome(make: Callable[[], object]) -> str:
    """What came of it, ``ok`` or the message; any other exception is a fault of ours."""
    try:
        make()
    except (MeshFileError, InputError, AccuracyError) as error:
        message = str(error)
    else:
        message = "ok"
    assert message
    assert "\n" not in message
    return message


@pytest.mark.parametrize("form", TEXT)
def test_damaged_text_ends_in_a_mesh_or_a_message(originals: Path, form: str) -> None:
    content = (originals / f"box.{form}").read_bytes()
    rng = np.random.default_rng(1)
    found = set()
    for _ in range(100):
        text = damaged(content, rng).decode(errors="replace")
        found.add(outcome(lambda text=text: solid_mesh(TEXT[form](text), 1.0, repair=bool(rng.integers(2))))[:12])
    assert len(found) > 5  # there are faults of many kinds


@settings(max_examples=150)
@given(st.text(alphabet="*NODELMTSYPCUGRIFAH3840,=.+-\n 12", max_size=300), st.sampled_from(sorted(TEXT)))
def test_any_text_ends_in_a_mesh_or_a_message(text: str, form: str) -> None:
    outcome(lambda: solid_mesh(TEXT[form](text), 1.0))


def in_a_fork(run: Callable[[], str | None]) -> int:
    """Exit status of a function in a fork: 0 done, 1 a message, 9 given up after some time; others are crashes."""
    child = os.fork()
    if child == 0:
        status = 70
        try:
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, 1)
            os.dup2(null, 2)
            status = 1 if run() else 0
        finally:
            os._exit(status)
    end = time.monotonic() + SECONDS
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.002)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return 9


def by_meshio(path: Path, arrays: Path, message: str = "it stopped") -> RawMesh:
    if not arrays.is_file():
        raise MeshFileError(message)
    return meshio_reader._load_arrays(arrays)


def read_damaged(path: Path, arrays: Path) -> str:
    """What the product makes of a file that meshio reads."""
    arrays.unlink(missing_ok=True)
    status = in_a_fork(lambda: meshio_reader.main([str(path), str(arrays)]))
    assert status in (0, 1, 9), f"status {status}"
    assert arrays.is_file() == (status == 0)  # whole or not at all
    return outcome(lambda: solid_mesh(by_meshio(path, arrays), 1.0, repair=True))


@pytest.mark.parametrize("form", OTHER)
@pytest.mark.parametrize("n", [2, pytest.param(25, marks=pytest.mark.long)])
def test_what_meshio_reads_ends_in_a_mesh_or_a_message_when_damaged(
    originals: Path, form: str, n: int, tmp_path: Path
) -> None:
    content = (originals / f"box.{form}").read_bytes()
    rng = np.random.default_rng(n)
    path = tmp_path / f"box.{form}"
    for _ in range(n):
        path.write_bytes(damaged(content, rng))
        read_damaged(path, tmp_path / "arrays.npz")


def test_a_header_of_a_million_million_nodes_takes_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "huge.msh"
    for version, nodes in (
        ("4.1", "1 1000000000000 1 1000000000000\n3 1 0 1000000000000\n1\n"),
        ("2.2", "1000000000000\n"),
    ):
        path.write_text(f"$MeshFormat\n{version} 0 8\n$EndMeshFormat\n$Nodes\n{nodes}$EndNodes\n")
        assert read_damaged(path, tmp_path / "arrays.npz") != "ok"


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
def test_damaged_cad_files_end_in_a_mesh_or_a_message(originals: Path, seed: int, tmp_path: Path) -> None:
    from fmd.meshes.cad import main

    content = (originals / "box.step").read_bytes()
    rng = np.random.default_rng(seed)
    path, arrays = tmp_path / "box.step", tmp_path / "arrays.npz"
    for _ in range(8):
        path.write_bytes(damaged(content, rng))
        arrays.unlink(missing_ok=True)
        status = in_a_fork(lambda: main([str(path), str(arrays), "20", "0.01", '{"size": 0.5, "order": 2}']))
        assert status in (0, 1, 9) or status < 0  # OpenCASCADE may crash: the product tells so
        assert status == 0 or not arrays.is_file()


@pytest.fixture(scope="module")
def matrices(tmp_path_factory) -> Path:
    import scipy.io
    import scipy.sparse as sp

    folder = tmp_path_factory.mktemp("matrices")
    fe = assemble(SolidMesh(*hexahedral_bar(2.0, 1.0, 1.0, (2, 1, 1))), 1, Material(210e9, 0.3, 7800.0))
    scipy.io.mmwrite(folder / "K.mtx", fe.K)
    sp.save_npz(folder / "M.npz", fe.M)
    upper = sp.coo_array(sp.triu(fe.M))
    rows = zip(*upper.coords, upper.data, strict=True)
    (folder / "M.mtx").write_text(
        "".join(f"{i // 3 + 1},{i % 3 + 1}, {j // 3 + 1},{j % 3 + 1}, {v}\n" for i, j, v in rows)
    )
    np.savetxt(
        folder / "nodes.csv", np.c_[np.arange(len(fe.x)) + 1, fe.x], delimiter=",", header="node,x,y,z", comments=""
    )
    return folder


@pytest.mark.parametrize("name", ["K.mtx", "M.npz", "M.mtx", "nodes.csv"])
def test_damaged_matrices_end_in_a_body_or_a_message(matrices: Path, name: str, tmp_path: Path) -> None:
    content = (matrices / name).read_bytes()
    rng = np.random.default_rng(3)
    path = tmp_path / name
    files = {"stiffness": matrices / "K.mtx", "mass": matrices / "M.npz", "nodes": matrices / "nodes.csv"}
    role = {"K": "stiffness", "M": "mass", "n": "nodes"}[name[0]]
    assert outcome(lambda: read_matrices(**files, units=(1.0, 1.0, 1.0))) == "ok"
    found = set()
    for _ in range(100):
        path.write_bytes(damaged(content, rng))
        found.add(outcome(lambda: read_matrices(**files | {role: path}, units=(1.0, 1.0, 1.0)))[-30:])
    assert len(found) > 3
