"""A flexible body as its scene gives it, and the keys that the results of its stages are kept under."""

from typing import Any

from fmd.scene.imported_bodies import Meshless
from fmd.scene.scene import Scene
from fmd.scene.source_files import SourceFiles
from fmd.stages.parent_joint import read_parent_joint
from fmd.stages.piece_mesh import PieceMesh


class KeyedPart:
    """A flexible body of a scene before anything of it is computed: all that the keys of its stages are made of."""

    def __init__(self, scene: Scene, name: str, piece: PieceMesh | None = None) -> None:
        self.name, self.file, self.piece = name, scene.file, piece
        self.shape = scene.with_its_basis(name)
        self.source = SourceFiles.find(self.shape, scene.file, name) if piece is None else None
        self.joint = read_parent_joint(scene, name)
        self.contact_faces = scene.faces_in_contact(name, with_bodies=False)
        self.paired_faces = scene.faces_in_contact(name, with_bodies=True)
        self.loaded_markers: tuple[str, ...] = ()
        if self.contact_faces:
            self.loaded_markers = tuple(sorted({*scene.markers_under_load(name), *scene.markers_on_joints(name)}))
        self.frame = scene.simulation.frame if scene.moves else "joint-conforming"
        self.stiffening = scene.simulation.stiffening if scene.moves else "auto"

    @property
    def has_mesh(self) -> bool:
        """A mesh, and so stress and pictures: bodies that are given by their matrices have none."""
        return self.shape.shape not in ("matrices", "reduced")

    @property
    def is_reduced(self) -> bool:
        """A file holds the body reduced, by another program or by this one."""
        return self.shape.shape == "reduced"

    @property
    def is_supported(self) -> bool:
        """True if supports fix the body in its frame, and not its joint's section alone, which may turn freely."""
        return bool(self.shape.support) and not self.joint.free

    @property
    def has_default_clamp(self) -> bool:
        """True if a fixed joint alone holds a face of the whole body, which touches nothing, and nothing says how."""
        shape, joint = self.shape, self.joint
        if isinstance(shape, Meshless) or not joint.welded:
            return False
        if shape.support or shape.link or self.contact_faces:
            return False
        at = shape.marker[joint.marker]
        return at.attachment is None and at.is_face

    def key(self, stage: str) -> str:
        """Return the key that a stage's result is kept under; empty if it never is."""
        raise NotImplementedError


def mesh_inputs(part: KeyedPart) -> Any:
    """Return what a mesh depends on: the shape, and neither its material nor what is attached to it."""
    of_no_shape = ("E", "nu", "rho", "material", "modes", "marker", "support", "element", "link", "mass")
    return _identify(part, dict.fromkeys(of_no_shape, True) | {"mesh": {"formulation"}})


def assembly_inputs(part: KeyedPart) -> Any:
    """Return what stiffness and mass depend on."""
    return _identify(part, dict.fromkeys(("modes", "marker", "support", "element"), True))


def model_inputs(part: KeyedPart) -> Any:
    """Return what the matrices with markers, supports and joint depend on, and the solver of them."""
    shape, clamped = part.shape, part.has_default_clamp
    return (
        assembly_inputs(part),
        shape.marker,
        shape.support,
        part.joint,
        clamped,
        shape.modes.solver,
        shape.modes.ranks,
    )


def _identify(part: KeyedPart, without: dict[str, Any]) -> Any:
    """Return all that a stage's result depends on: a part's table but for some keys, its files and its piece."""
    without |= {"pieces": True, "sections": True}  # which a piece's mesh and markers know
    without |= {"lamina": {"__all__": {"strength"}}}  # of which only the plies' indices know
    table = part.shape.model_dump(mode="json", exclude=without)
    if part.piece:
        table["piece"] = part.piece.digest
    return table if part.source is None else part.source.identity(table)


def modes_inputs(part: KeyedPart) -> Any:
    """Return what modes depend on: what fixes them, and no damping or enrichment."""
    shape, markers, fixed = part.shape, part.shape.marker, ""
    without: Any = {"modes": {"damping", "enrich"}, "marker": True, "element": True}
    if shape.modes.boundary == "joint":
        fixed = repr((part.joint.floating, part.joint.free, markers[part.joint.marker].where))
    elif shape.modes.boundary == "interface":
        fixed = repr({name: markers[name] for name in shape.modes.interface or markers})
    return {
        "part": _identify(part, without),
        "axis": part.joint.axis if shape.modes.family != "any" else "",
        "rigid": {name: marker.where for name, marker in markers.items() if marker.attachment == "rigid"},
        "clamp": repr(markers[part.joint.marker]) if part.has_default_clamp else "",
        "fixed": fixed,
    }


def body_inputs(part: KeyedPart) -> Any:
    """Return what the reduced body depends on."""
    return {
        "modes": part.key("modes"),
        "enrich": part.shape.modes.enrich,
        "markers": part.shape.model_dump(mode="json", include={"marker"}),
        "joint": repr(part.joint),
        "frame": part.frame,
        "stiffening": part.stiffening if part.is_reduced else "",  # that of a file may be left out
    }


def digest_of_body(part: KeyedPart) -> Any:
    """Return the key of the reduced body, for results that depend on nothing else."""
    return part.key("body")


def contact_inputs(part: KeyedPart) -> Any:
    """Return what the points that may touch something depend on, and their flexibility."""
    faces = {"faces": part.contact_faces, "paired": part.paired_faces, "loaded": part.loaded_markers}
    return {"body": part.key("body"), **faces}
