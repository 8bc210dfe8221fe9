"""Bodies of any kind in a scene file; the key ``shape`` says which kind a table is."""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import BeforeValidator

from fmd.scene.bar import Bar
from fmd.scene.beams import Profile, Shaft
from fmd.scene.gears import SpurGear
from fmd.scene.imported_bodies import CadPart, MatrixPart, MeshedPart
from fmd.scene.kinds import KindBy
from fmd.scene.propeller import Propeller
from fmd.scene.reduced_bodies import ReducedPart
from fmd.scene.rigid_bodies import PointMass, RigidBody, Rod
from fmd.scene.shells import Plate, Tube


def _with_shape(body: object) -> object:
    """Add the shape of a body that leaves it out because its mesh or matrices come from files."""
    if isinstance(body, dict) and "shape" not in body:
        mesh = body.get("mesh")
        if "matrices" in body:
            return body | {"shape": "matrices"}
        if "body" in body:
            return body | {"shape": "reduced"}
        for key, shape in (("file", "mesh"), ("cad", "cad")):
            if isinstance(mesh, dict) and key in mesh:
                return body | {"shape": shape}
    return body


Flexible = Bar | Plate | Tube | Shaft | Profile | Propeller | SpurGear | MeshedPart | CadPart | MatrixPart | ReducedPart
Body = Annotated[
    Bar
    | Plate
    | Tube
    | Shaft
    | Profile
    | Propeller
    | SpurGear
    | Rod
    | PointMass
    | RigidBody
    | MeshedPart
    | CadPart
    | MatrixPart
    | ReducedPart,
    KindBy("shape"),
    BeforeValidator(_with_shape),
]


def wanted_pieces(bodies: Mapping[str, Flexible]) -> dict[str, int | Literal["auto"]]:
    """Return the numbers of pieces of those flexible bodies that are to be cut, by name; some kinds never are."""
    counts = {name: getattr(body, "pieces", 1) for name, body in bodies.items()}
    return {name: count for name, count in counts.items() if count != 1}
