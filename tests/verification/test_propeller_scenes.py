"""The propeller's scenes, on a coarse mesh: what a run of each leaves, and what is refused."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve

from fmd import Pipeline, load_scene
from fmd.cli.app import main
from fmd.core.errors import AccuracyError, InputError
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.recovery.stress import von_mises
from fmd.reduction.body_file import load_body
from fmd.stages.mechanism import build_mechanism, find_start

pytestmark = pytest.mark.slow

COARSE = (
    "body.propeller.mesh={order=1,sleeve=[24,2,1],joint=[2,2,2],blade=[2,2,4]}",
    "body.propeller.modes.count=12",
    "simulation.duration=2 ms",
    "simulation.step=4 us",
)
RATE = 8000 * 2 * np.pi / 60


def coarse(name: str, *overrides: str) -> Pipeline:
    return Pipeline(load_scene(name, [*COARSE, *overrides]))


def test_the_scene_asks_for_the_papers_mesh_and_speed() -> None:
    scene = load_scene("propeller")
    part, drive = scene.flexible["propeller"], scene.drive["spin_up"]
    assert part.mesh.sleeve == (66, 10, 3)
    assert (part.diameter, part.rho, part.mesh.order) == (0.9, 2780.0, 1)
    assert drive.type == "motion"
    assert drive.angle is not None
    from fmd.stages.signals import signal_of

    angle, rate, acceleration = signal_of(drive.angle).value(0.02)
    # 8000 rpm from rest in 0.02 s: half of 837.758 rad/s times 0.02 s
    assert (angle, rate) == pytest.approx((8.37758, 837.758), rel=1e-6)
    assert acceleration == pytest.approx(837.758 / 0.02, rel=1e-6)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("mesh.sleeve=[65,10,3]", "can't be shared by 6 blades; the nearest that can is 66"),
        ("mesh.sleeve=[70,10,3]", "the nearest that can is 72"),
        ("mesh.joint=[9,8,12]", "must be the sleeve's number along the axis, 10"),
        ("mesh.joint=[10,11,12]", "leaves no gap between blades; at most 10 of the 11 around fit"),
        ("mesh.blade=[10,7,27]", "must be the joint's, 8"),
        ("hub=70 mm", "must be more than bore, 0.08 m"),
        ("diameter=20 cm", "must be more than root, 0.26 m"),
        ("blades=1", "must be greater than or equal to 2"),
        ("seat=60 deg", "leaves no gap between blades; must be less than 60 deg"),
        ("marker.tip.face=tip-7", "no such face; did you mean 'tip-"),
        ("element.joint.part=joint", "no such part; did you mean 'joints'?"),
    ],
)
def test_what_cant_be_meshed_is_refused_with_what_works(value: str, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        load_scene("propeller", [f"body.propeller.{value}"])


@pytest.mark.parametrize("order", [1, 2])
def test_a_marker_holds_the_nodes_of_its_face_alone(order: int) -> None:
    part = coarse("propeller", f"body.propeller.mesh.order={order}").part
    radius = np.hypot(*part.space.x[part.markers["tip"].nodes][:, :2].T)
    assert radius == pytest.approx(0.45, rel=1e-9)  # curved edges have their middles on the circle too
    # three by three points, and the middles of twelve edges
    assert len(radius) == (9 if order == 1 else 9 + 12)


def test_a_base_gives_what_a_scene_leaves_out(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text('base = "propeller"\ntitle = "Mine"\n')
    scene, ready = load_scene(mine), load_scene("propeller")
    assert scene.title == "Mine"
    assert scene.model_dump(exclude={"title"}) == ready.model_dump(exclude={"title"})
    mine.write_text('base = "propellor"\n')
    with pytest.raises(InputError, match="did you mean 'propeller'"):
        load_scene(mine)
    mine.write_text('base = "propeller-gust"\n')  # which has a base itself
    assert load_scene(mine).model_dump() == load_scene("propeller-gust").model_dump()


def test_by_constant_torque_it_comes_to_the_same_speed() -> None:
    """The torque is that of the fine mesh; the work it has done is the energy there is."""
    run = coarse("propeller-torque", "simulation.duration=4 ms", "simulation.step=2 us")
    motion = run.motion
    torque = run.scene.drive["spin_up"].torque.constant
    kinetic, strain = motion.energies
    assert (kinetic + strain)[-1] == pytest.approx(torque * motion.joint_position("shaft")[-1], rel=1e-3)
    # the blades lag behind the hub by as much as they ring
    assert motion.joint_position("shaft")[-1] == pytest.approx(
        0.5 * torque / run.body.inertia_about_joint * 0.004**2, rel=0.08
    )


def test_a_steady_start_stays_steady_until_the_gust_comes() -> None:
    late = 'drive.gust.force={formula="1500 if t > 0.001 else 0", unit="N"}'
    run = coarse("propeller-gust", late)
    q, times = run.motion.modal("propeller"), run.motion.times
    before = times <= 0.001
    assert np.abs(q[before] - q[0]).max() < 1e-9 * np.abs(q[0]).max()
    assert np.abs(q[-1] - q[0]).max() > 0.01 * np.abs(q[0]).max()
    # the steady state solves (ω² + Ω² K_G − Ω² D) q = Ω² D_0
    body = run.bodies["propeller"]
    D = np.einsum("ab,abij->ij", np.diag([1.0, 1.0, 0.0]), body.integrals.G)
    K = np.diag(body.omega**2) - RATE**2 * D[1:, 1:]
    assert q[0] == pytest.approx(solve(K, RATE**2 * D[1:, 0]), rel=1e-6, abs=1e-8 * np.abs(q[0]).max())


def test_beyond_the_critical_speed_only_a_stiffened_body_has_a_steady_state() -> None:
    run = coarse("propeller-gust", 'drive.rotation.angle={formula="9000*t", unit="rad"}', "simulation.stiffening=on")
    assert np.isfinite(find_start(run.scene, run.system)[0]).all()
    linear = CompiledSystem(build_mechanism(run.scene, {"propeller": run.part.body}))
    with pytest.raises(AccuracyError, match="no steady state"):
        find_start(run.scene, linear)


def test_loads_out_of_the_plane_are_in_the_basis() -> None:
    """The gust pushes along the axis: the reduced body answers a constant one as the whole model does."""
    run = coarse("propeller-gust")
    fe, part = run.fe, run.part
    load = part.markers["pressure"].columns(len(fe.x), np.zeros((0, 3)))[:, :, 2]
    held = part.markers["hub"].columns(len(fe.x), np.eye(3)).reshape(-1, 6)
    lhs = np.block([[fe.K.toarray(), held], [held.T, np.zeros((6, 6))]])
    whole = solve(lhs, np.r_[load.ravel(), np.zeros(6)])[:-6]
    shapes = part.body.shapes.reshape(len(whole), -1)
    reduced = shapes @ ((shapes.T @ load.ravel()) / part.body.omega**2)
    assert np.abs(reduced - whole).max() < 1e-6 * np.abs(whole).max()


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `fmd run` leaves, pictures small."""
    folder = tmp_path_factory.mktemp("propeller")
    scene = load_scene("propeller")
    small = [f"output.{k}.size=[320,200]" for k, o in enumerate(scene.output) if o.type not in ("chart", "export")]
    film = next(k for k, output in enumerate(scene.output) if output.type == "film")
    settings = [*COARSE, *small, f"output.{film}.frames=3"]
    with pytest.raises(SystemExit, match="0"):
        main(
            [
                "run",
                "propeller",
                "--no-budget",
                "--out",
                str(folder),
                *(word for text in settings for word in ("--set", text)),
            ]
        )
    return folder


def test_a_run_leaves_every_file_it_names(results: Path) -> None:
    summary = json.loads((results / "summary.json").read_text())
    assert sorted([*summary["files"], "summary.json"]) == sorted(path.name for path in results.iterdir())
    assert len(summary["files"]) == 1 + len(load_scene("propeller").output)
    assert summary["final"]["joint_positions"]["shaft"] == pytest.approx(0.5 * 41887.902 * 0.002**2)
    plain, sub_cycled = summary["integrations"]
    assert plain["element_stress_difference"]["propeller.joint"] == 0.0
    assert 0 < sub_cycled["element_stress_difference"]["propeller.joint"] < 0.01


def test_the_body_file_gives_back_the_body_without_a_mesh(results: Path) -> None:
    saved = load_body(results / "body.nc")
    run = coarse("propeller")
    body = run.bodies["propeller"]
    assert saved.body.omega == pytest.approx(body.omega, rel=1e-9)
    assert saved.body.integrals.stiffening.shape == body.integrals.stiffening.shape
    assert saved.stress is not None
    q = run.motion.modal("propeller")[-1]
    assert von_mises(saved.stress @ q) == pytest.approx(run.stress.von_mises(0.002), rel=1e-6)


def test_the_series_moves_as_the_propeller_does(results: Path) -> None:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOHDF import vtkHDFReader

    reader = vtkHDFReader()
    reader.SetFileName(str(results / "motion.vtkhdf"))
    reader.UpdateInformation()
    reader.SetStep(reader.GetNumberOfSteps() - 1)
    reader.Update()
    grid: Any = reader.GetOutput()
    x = vtk_to_numpy(grid.GetPoints().GetData())
    placed = x + vtk_to_numpy(grid.GetPointData().GetArray("displacement"))
    run = coarse("propeller")
    motion, tip = run.motion, run.body.markers["tip"]
    linear = tip.position + tip.translation @ motion.modal("propeller")[-1]  # a field has no part of second order
    assert run.part.markers["tip"].translation(placed) == pytest.approx(
        motion.placed("propeller", linear[None], -1)[0], abs=1e-6
    )
    assert placed == pytest.approx(
        motion.placed("propeller", run.body.x + run.body.shapes @ motion.modal("propeller")[-1], -1), abs=1e-6
    )
    vm = vtk_to_numpy(grid.GetPointData().GetArray("von_mises"))
    assert vm.max() == pytest.approx(run.stress.von_mises(0.002).max(), rel=1e-5)


def test_components_and_principal_stresses_are_those_of_the_tensor() -> None:
    run = coarse("propeller")
    modal = run.part.element_stress[0]
    tensor = modal @ run.motion.modal("propeller")[-1]
    assert run.element_stress("propeller.joint", "zz")["central-difference"][-1] == pytest.approx(tensor[2])
    xx, yy, zz, yz, xz, xy = tensor
    full = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    principal = [run.element_stress("propeller.joint", f"principal {k}")["central-difference"][-1] for k in (3, 2, 1)]
    assert principal == pytest.approx(np.linalg.eigvalsh(full))


def test_a_named_element_changes_nothing_but_its_stress() -> None:
    """Mesh, modes and body are kept under keys that don't know of it."""
    places = (f"body.propeller.element.joint.at=['{x} mm','0 mm','0 mm']" for x in (80, 125))
    one, other = (coarse("propeller", place).part for place in places)
    assert one.key("mesh") == other.key("mesh")
    assert one.key("body") == other.key("body")
    assert one.elements != other.elements
