"""Spur gears: profiles that roll on one another, meshes, and their static mesh against ISO 6336 and symmetry."""

from functools import cache
from math import cos, pi, sin, tan
from pathlib import Path

import numpy as np
import pytest

from benchmarks.gears import disc_twist, iso_root_stress, iso_stiffness
from fmd.contact.gear_pair import GearMeshAnswer, ToothFlexibility, mesh_gears
from fmd.core.cache import Cache
from fmd.core.errors import InputError
from fmd.core.involute import GearPair, Tooth, tight_distance
from fmd.output.gear_mesh import MeshedGears, compute_gear_mesh, describe_gear_mesh, write_gear_mesh
from fmd.scene.scene import load_scene
from fmd.stages.pipeline import Pipeline

MESH = "={flank=4,fillet=6,across=6,rim=5,along=1}"
COARSE = f"body.pinion.mesh{MESH}", f"body.wheel.mesh{MESH}"
LOAD, WIDTH = 3500.0, 0.02
STANDARD = {"module": 0.003, "alpha": pi / 9, "addendum": 1.0, "dedendum": 1.25, "rounding": 0.38}


@cache
def pinion() -> tuple[Pipeline, ToothFlexibility]:
    run = Pipeline(load_scene("gears", [*COARSE, "output.0.points=8"]), Cache(None))
    return run, run.wholes["pinion"].tooth_flexibility


@cache
def equal_gears(points: int = 40) -> tuple[GearPair, GearMeshAnswer]:
    own = pinion()[1]
    distance = tight_distance(own.tooth, own.tooth)
    assert distance is not None
    pair = GearPair(own.tooth, own.tooth, distance)
    return pair, mesh_gears(pair, (own, own), WIDTH, LOAD, points)


@pytest.mark.parametrize(("teeth", "shift"), [(20, 0.0), (12, 0.4), (45, -0.3), (150, 0.2)])
def test_fillet_meets_involute_and_root_circle_without_a_kink(teeth: int, shift: float) -> None:
    tooth = Tooth(teeth=teeth, shift=shift, **STANDARD)
    near = np.array([0.0, 1e-6])
    fillet, flank = tooth.fillet(tooth.alpha + near), tooth.flank(tooth.form_roll + near)
    assert fillet[0] == pytest.approx(flank[0], abs=1e-12)
    down, up = fillet[1] - fillet[0], flank[1] - flank[0]
    assert down @ up == pytest.approx(-np.linalg.norm(down) * np.linalg.norm(up), rel=1e-6)
    root = tooth.fillet(np.array([0.5 * pi - 1e-6, 0.5 * pi]))
    assert np.linalg.norm(root[1]) == pytest.approx(tooth.root_radius, rel=1e-12)
    assert abs((root[1] - root[0]) @ root[1]) < 1e-5 * np.linalg.norm(root[1] - root[0]) * tooth.root_radius
    assert tooth.half_angle(tooth.pitch_radius) == pytest.approx((pi / 2 + 2 * shift * tan(pi / 9)) / teeth)


@pytest.mark.parametrize(("teeth", "shifts", "wider"), [((20, 30), (0.0, 0.0), 0.0), ((17, 40), (0.3, 0.1), 3e-4)])
def test_rigid_flanks_touch_on_the_path_alone_and_never_overlap_at_the_exact_ratio(
    teeth: tuple[int, int], shifts: tuple[float, float], wider: float
) -> None:
    """The pinion's flank is seen from the wheel's tooth: at each radius its angle beyond the tooth's is the gap."""
    one, other = (Tooth(teeth=n, shift=x, **STANDARD) for n, x in zip(teeth, shifts, strict=True))
    tight = tight_distance(one, other)
    assert tight is not None
    assert abs(GearPair(one, other, tight).backlash) < 1e-12
    pair = GearPair(one, other, tight + wider)
    pitch = pair.distance / (1 + teeth[1] / teeth[0])
    flank = one.flank(np.linspace(one.form_roll, one.tip_roll, 4000))
    begin, end = (place / one.base_radius - tan(pair.alpha) for place in pair.path)  # angles from the pitch point
    for angle in np.linspace(1.3 * begin, 1.3 * end, 41):
        seen = flank @ _turn(angle - one.half_angle(pitch)).T - (pair.distance, 0.0)
        axis = pi - other.half_angle(pair.distance - pitch) - angle * teeth[0] / teeth[1]
        x, y = (seen @ _turn(-axis).T).T
        radius = np.hypot(x, y)
        met = (radius >= np.linalg.norm(other.flank(other.form_roll))) & (radius <= other.tip_radius)
        gaps = [np.arctan2(b, a) - other.half_angle(r) for a, b, r in zip(x[met], y[met], radius[met], strict=True)]
        least = other.base_radius * min(gaps, default=1.0)
        if begin < angle < end:
            assert -1e-12 < least < 1e-9
        else:
            s, back = one.base_radius * (angle + tan(pair.alpha)), GearPair(other, one, pair.distance)
            gap = float(pair.gap(np.array(s)))
            if angle > end:  # the pinion's tip is nearest, and the angle about the wheel is what counts
                assert least == pytest.approx(gap, rel=1e-9)
            assert gap == pytest.approx(float(back.gap(np.array(pair.distance * sin(pair.alpha) - s))), rel=1e-9)
    assert pair.contact_ratio == pytest.approx((end - begin) / (2 * pi / teeth[0]))


def _turn(angle: float) -> np.ndarray:
    return np.array([[cos(angle), -sin(angle)], [sin(angle), cos(angle)]])


def test_mesh_has_the_volume_and_the_faces_of_the_profile() -> None:
    """Of the volume: the area within dense profiles of three teeth and the root circle, by the shoelace formula."""
    part = pinion()[0].wholes["pinion"]
    gear, tooth = part.shape, part.shape.tooth
    side = np.concatenate(
        [
            tooth.fillet(np.linspace(pi / 2, tooth.alpha, 3000)),
            tooth.flank(np.linspace(tooth.form_roll, tooth.tip_roll, 3000)),
        ]
    )
    x, y = np.concatenate([side, (side * (1, -1))[::-1]]).T
    within = 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    r, a, foot, half = (
        tooth.tip_radius,
        tooth.root_radius,
        np.arctan2(side[0, 1], side[0, 0]),
        np.arctan2(*side[-1, ::-1]),
    )
    tip, root = 0.5 * r**2 * (2 * half - sin(2 * half)), 0.5 * a**2 * (2 * foot - sin(2 * foot))
    area = pi * (a**2 - gear.bore**2 / 4) + 3 * (within + tip - root)
    assert part.mesh.volume == pytest.approx(area * gear.width, rel=1e-5)
    radius = np.hypot(*part.mesh.points[:, :2].T)
    for face, exact in (("bore", gear.bore / 2), ("tips", tooth.tip_radius)):
        assert radius[part.mesh.faces[face]] == pytest.approx(exact, rel=1e-9)
    assert radius[part.mesh.faces["flanks"]].min() >= np.linalg.norm(tooth.flank(tooth.form_roll)) - 1e-12


def test_equal_gears_share_the_load_as_mirror_images() -> None:
    """About the pitch point pinion and wheel change their parts: a law that neither gear's analysis knows of."""
    pair, found = equal_gears()
    both = (found.forces > 0.0).all(axis=1)
    assert found.forces.sum(axis=1) == pytest.approx(LOAD, rel=1e-12)
    assert both.mean() == pytest.approx(pair.contact_ratio - 1.0, abs=0.03)
    s = found.s[both]
    mirrored = sum(pair.path) - pair.pinion.base_pitch - s
    inner = (mirrored > s[0]) & (mirrored < s[-1])
    pinion_stress, wheel_stress = found.root_stress[:, both]
    for values, image in (
        (found.forces[both, 0], found.forces[both, 1]),
        (found.error[both], found.error[both]),
        (pinion_stress[:, 0], wheel_stress[:, 1]),
    ):
        assert np.interp(mirrored, s, values)[inner] == pytest.approx(image[inner], rel=2e-3)
    assert found.single == pytest.approx(found.single[::-1], rel=1e-8)


def test_stiffness_is_that_of_iso_6336_beside_the_discs_own_twist() -> None:
    """ISO 6336-1, method B: theoretical single stiffness, and that of the mesh; the twist is a thick ring's."""
    pair, found = equal_gears()
    theory, _, whole = iso_stiffness(pair)
    run, own = pinion()
    twist = 2 * disc_twist(run.scene.body["pinion"], own)
    single = 1 / (WIDTH / found.single.max() - twist)
    assert single == pytest.approx(theory, rel=0.05)
    assert found.stiffness.mean() / WIDTH == pytest.approx(whole, rel=0.1)


def test_stress_at_the_root_is_that_of_iso_6336_3() -> None:
    """Nominal stress by Y_F and Y_S, method B, for the load at the outer point of single contact."""
    pair, found = equal_gears()
    nominal = iso_root_stress(pair.pinion, pair.contact_ratio, LOAD, WIDTH)
    assert found.root_stress.max() == pytest.approx(nominal, rel=0.1)


def test_error_vanishes_as_the_gears_become_rigid() -> None:
    """Between linear and a little more, as Hertz's approach has a logarithm of the modulus."""
    pair, soft = equal_gears()
    own = pinion()[1]
    rigid = ToothFlexibility(own.tooth, own.middle, 1e-6 * own.moved, own.stress, 1e6 * own.E, own.nu)
    found = mesh_gears(pair, (rigid, rigid), WIDTH, LOAD, 10)
    assert 0.0 < found.error.max() < 3e-6 * soft.error.max()


def test_output_of_a_mesh_has_a_table_and_errors_that_hold(tmp_path: Path) -> None:
    """Of a load that all angles' forces sum to, and a mean error by load over stiffness; finer angles are within."""
    run = pinion()[0]
    (output,) = (own for own in run.scene.output if own.type == "gear-mesh")
    found = compute_gear_mesh(run, output)
    summary = write_gear_mesh(run, output, found, tmp_path, chart=False)
    rows = np.genfromtxt(tmp_path / "mesh.csv", delimiter=",", names=True)
    assert rows["share_1"] + np.nan_to_num(rows["share_2"]) == pytest.approx(1.0, rel=1e-8)
    assert summary["load_n"] == pytest.approx(100.0 / (0.03 * cos(pi / 9)))
    assert summary["transmission_error_m"] == pytest.approx(1e-6 * rows["transmission_error_um"].mean(), rel=1e-6)
    assert summary["warnings"] == []
    assert all(0.0 < error < 0.5 * summary[name] for name, error in summary["errors"].items())
    hundreds = summary | {"errors": dict.fromkeys(summary["errors"], 149e-9)}
    assert "transmission error 10." in (text := "\n".join(describe_gear_mesh(hundreds)))
    assert "± 149 nm" in text
    coarsest = MeshedGears(found.pair, found.load, found.fine, None)
    (warning,) = write_gear_mesh(run, output, coarsest, tmp_path, chart=False)["warnings"]
    assert "more of them help" in warning


def test_a_pair_that_another_one_moves_apart_carries_nothing() -> None:
    """Rims that are far softer than teeth let a loaded pair take the next one along farther than its own flanks."""
    own, pair = pinion()[1], equal_gears()[0]
    factors = np.array([7.33, 1.0, 7.33])[:, None, None, None, None]
    soft = ToothFlexibility(own.tooth, own.middle, own.moved * factors, own.stress, own.E, own.nu)
    found = mesh_gears(pair, (soft, soft), WIDTH, LOAD, 10)
    both = found.s + pair.pinion.base_pitch <= pair.path[1]
    assert (found.forces[both] == 0.0).any()
    assert (found.forces >= 0.0).all()
    assert found.forces.sum(axis=1) == pytest.approx(LOAD)


@pytest.mark.parametrize("kind", ["rigid", "average"])
def test_a_link_on_the_bore_leaves_the_teeth_as_they_are(kind: str) -> None:
    """The bore is held; the link's points, on arms longer than its radius, have no stiffness of their own."""
    bare = "body.pinion.mesh={flank=2,fillet=2,across=2,rim=2,along=1}"
    link = f"body.pinion.link={{axle={{face='bore',type='{kind}'}}}}", "body.pinion.marker.bore={link='axle'}"
    found = []
    for changes in ([bare], [bare, *link]):
        run = Pipeline(load_scene("gears", changes), Cache(None))
        found.append(run.wholes["pinion"].tooth_flexibility)
    assert len(run.wholes["pinion"].fe.x) == len(run.wholes["pinion"].space.x) + 7
    for name in ("moved", "stress"):
        values, wanted = (getattr(own, name) for own in found[::-1])
        assert values == pytest.approx(wanted, abs=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("output.0.distance='74.9 mm'", "lets the teeth jam; 75 mm is without backlash"),
        ("output.0.distance='78 mm'", "leaves a contact ratio of"),
        ("output.0.wheel='whel'", "did you mean 'wheel'"),
        ("body.wheel.module='4 mm'", "module of 0.004 and the pinion one of 0.003"),
        ("body.pinion.mesh={teeth=1}", "has 1 teeth in its mesh; mesh.teeth = 3 is needed"),
        ("body.pinion.teeth=12", "lets the rack undercut the teeth"),
        ("body.pinion.shift=1.4", "makes the teeth pointed below their tips"),
        ("body.pinion.bore='60 mm'", "must be less than the root circle's diameter, 52.5 mm"),
        ("body.pinion.rounding=0.6", "is too large for the rack's depth and space"),
        ("body.wheel.addendum=1.3", "is met below its involutes"),
    ],
)
def test_gears_that_cannot_mesh_are_refused(override: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_scene("gears", [override])


def test_gears_with_backlash_at_any_distance_need_one_and_take_any_that_is_wide_enough() -> None:
    """At ``inv α + 2 Σx tan α/Σz < 0`` no working angle is without backlash; base circles still have to be apart."""
    low = [f"body.{name}.{key}" for name in ("pinion", "wheel") for key in ("teeth=40", "shift=-1.0")]
    with pytest.raises(InputError, match=r"have backlash at any distance of their axes; more than 112\.76 mm"):
        load_scene("gears", low)
    with pytest.raises(InputError, match=r"lets the teeth jam; more than 112\.7631 mm works"):
        load_scene("gears", [*low, "output.0.distance='112 mm'"])
    tooth = Tooth(teeth=40, shift=-1.0, **STANDARD)
    assert GearPair(tooth, tooth, 0.114).backlash > 0.0
