"""The page of a mechanism as it is assembled, to be looked at before it runs, and as it ran."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.html import scaled
from fmd.core.limits.shown import COINCIDENT
from fmd.fem.markers import facets_on_face
from fmd.fem.surface import surface_facets
from fmd.output.mechanism_view import view_mechanism
from fmd.output.report.page import render_page
from fmd.output.report.view3d import describe_mechanism, encode
from fmd.recovery.motion import Motion
from fmd.render.camera import Camera
from fmd.stages.pipeline import Pipeline
from fmd.stages.poses import Clip, find_clips, pose_as_marched, run_at_poses, undeformed_start


def make_view_page(run: Pipeline, overrides: Sequence[str] = (), motion: Motion | None = None) -> str:
    """Make the page of a run's mechanism: bodies, markers, joints, loads and faces by name, joints moved by sliders.

    Nothing is integrated; of a flexible body the mesh and its reduction are needed. A motion of the run is played.

    Raises
    ------
    InputError
        The scene has nothing that moves.
    """
    if not run.scene.moves:
        message = "a part alone has no mechanism to look at; `fmd mesh` and `fmd modes` show a part"
        raise InputError(run.scene.file, "simulation", None, message)
    return render_page(
        "view.html",
        title=run.scene.title,
        scene=run.scene.name,
        overrides=overrides,
        view=collect_poses(run, motion),
        closing=", ".join(run.divided_scene.closing),
        scene_table=run.scene._repr_html_(),
    )


def collect_poses(run: Pipeline, motion: Motion | None = None) -> dict[str, Any]:
    """Collect a mechanism at the start, and along each coordinate that a slider moves, as `describe_mechanism` does.

    With it come ``clips``: ``name``, number of ``first`` frame, ``count`` and number of the one at the ``start`` among
    these; ``film``, the number of the clip that shows a motion of the run, if one is given; ``clocks``, a text for each
    frame; ``markers``, ``names`` and float32 ``points`` (n_frames, n_markers, 3) [m]; and, of bodies with named faces,
    ``faces``: their ``names`` and that of each triangle by number ``of`` (n_triangles,), the last one empty.
    """
    q0 = undeformed_start(run)
    still = run_at_poses(run, np.zeros(1), q0[None])
    extent = view_mechanism(still, np.zeros(1, dtype=np.int64), stressed=False).around()
    clips = find_clips(run, q0, float(np.linalg.norm(np.ptp(extent, axis=0))) / 2)
    clips += () if motion is None else (pose_as_marched(motion),)
    times = np.concatenate([np.zeros(1), *(clip.times for clip in clips)])
    posed = run_at_poses(run, times, np.concatenate([q0[None], *(clip.q for clip in clips)]))
    frames = np.arange(len(times))
    moving = view_mechanism(posed, frames, stressed=False, loads=True)
    view = describe_mechanism(moving, Camera(), 1.0, (0.0, 1.0))
    first = 1 + np.cumsum([0, *(len(clip.values) for clip in clips)])
    return view | {
        "bodies": [body | _named_faces(run, body["name"]) for body in view["bodies"]],
        "frame": 0,
        "clocks": ["at the start", *(text for clip in clips for text in _texts(clip))],
        "clips": [
            {"name": clip.name, "first": int(at), "count": len(clip.values), "start": clip.start}
            for clip, at in zip(clips, first, strict=False)
        ],
        "film": None if motion is None else len(clips) - 1,
        "markers": _markers(posed),
    }


def _texts(clip: Clip) -> list[str]:
    if clip.unit == "rad":
        return [f"{clip.name} {value:.1f}°" for value in np.degrees(clip.values)]
    return [f"{clip.name} {scaled(value, clip.unit, 3)}" for value in clip.values]


def _markers(posed: Pipeline) -> dict[str, Any]:
    """Collect the places of all markers of the scene's bodies in all poses, those that coincide by one name."""
    kinematics, mechanism = posed.motion.kinematics, posed.mechanism
    found: dict[bytes, tuple[list[str], Array]] = {}
    for number, link in enumerate(mechanism.links):
        for marker in link.markers if link.name in posed.scene.body else ():
            points = kinematics.marker_position(number, marker)
            alike = np.round(points / COINCIDENT).astype(np.int64).tobytes()
            found.setdefault(alike, ([], points))[0].append(f"{link.name}.{marker}")
    points = np.stack([at for _, at in found.values()], axis=1) if found else np.zeros((len(posed.motion.times), 0, 3))
    return {"names": [", ".join(names) for names, _ in found.values()], "points": encode(points, "<f4")}


def _named_faces(run: Pipeline, body: str) -> dict[str, Any]:
    """Return the names of a flexible body's faces, and which of them each triangle of its surface is on."""
    part = run.wholes.get(body)
    if part is None or not part.has_mesh or not part.mesh.faces:
        return {}
    names = [*part.mesh.faces, ""]
    labels = np.full(sum(len(own.space.boundary_facets[0]) for own in part.space.members), len(names) - 1)
    for number, face in enumerate(part.mesh.faces.values()):
        for own in part.space.members:
            labels[own.first_facet + facets_on_face(own.space, own.own_points(face))] = number
    return {"faces": {"names": names, "of": encode(labels[surface_facets(part.space)], "<u2")}}
