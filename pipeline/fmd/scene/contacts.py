"""Contacts in a scene file: faces of flexible bodies and surfaces of rigid ones that may touch something."""

from collections.abc import Collection, Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from fmd.core.limits.contact import LEAST_RESTITUTION
from fmd.core.units import Length, NonNegativeCompliance, NonNegativeTime, PositiveLength
from fmd.scene.reading import FaultError, SceneTable, UnknownNameError
from fmd.scene.stress_outputs import ContactPressure
from fmd.scene.values import Axis, Number, PlaceName


class Contact(SceneTable):
    """A contact of a body with a plane of the ground or with another body, and its friction.

    A flexible body touches with the face of an averaged marker; its points are those that a constant pressure acts on.
    What its modes leave out of the deflection by forces on them is known from its mesh, and so is the pressure. A rigid
    body touches with one of its surfaces, a ball, a box, a pin, a bore or triangles of a file, whose flexibility is a
    half-space's.

    Example:

        [contact.floor]
        between = ["ground", "block.bottom"]
        normal = [0, 0, 1]
        friction = 0.3

        [contact.strike]
        between = ["block.top", "rod.end"]
    """

    # The ground or a place on it, where the plane is, and a marker on the face or a surface of a rigid body; or two of
    # these, of two bodies.
    between: tuple[PlaceName, PlaceName]
    normal: Axis | None = None  # Direction out of the ground, in the axes of the place; its length doesn't count.
    friction: Annotated[Number, Field(ge=0.0, le=10.0)] = 0.0  # Coefficient of friction.
    clearance: Length = 0.0  # What the gap is wider than drawn [m]; of an interference fit it is negative.
    # Time β of the damping of the flexibility that modes leave out [s]: a deflection w takes the force of ``w + β ẇ``.
    # Contacts with a body in common have the same. It shortens the longest step.
    damping: NonNegativeTime = 0.0
    # Coefficient of wear over hardness, k/H [1/Pa]: each of both faces loses the depth ``k/H ∫ p |v| dt`` by pressure
    # and slip (Archard). The shape stays as it is. Of two materials, scale the result to the other's coefficient.
    wear: NonNegativeCompliance = 0.0
    # Of two rigid bodies, or one and a plane, the speed after a shock over that before, if nothing else holds them.
    restitution: Annotated[Number, Field(ge=LEAST_RESTITUTION, le=1.0)] = 1.0
    # What gives the flexibility near a contact with a plane: the ``"mesh"``, or, on a sphere, a cylinder, a cone or an
    # ellipsoid, a ``"half-space"`` with a fine grid where the face is lowest, which it follows. ``"auto"`` takes this
    # where elements are larger than half the contact.
    near_field: Literal["auto", "mesh", "half-space"] = "auto"
    points: Annotated[int, Field(ge=50, le=1000)] = 400  # About how many points the grid has.
    # Width of the grid [m], more than the contact's; by default that of the contact by twice the weight, or by a shock
    # with the energy of the start, and 45 % more.
    width: PositiveLength | None = None

    @field_validator("between", mode="before")
    @classmethod
    def _two_surfaces(cls, given: Any) -> Any:
        if isinstance(given, list | tuple) and len(given) > 2:
            raise ValueError("must be two surfaces; each two of more take a contact of their own")
        return given

    def _check(self) -> None:
        first, second = (end.partition(".")[0] for end in self.between)
        if first == second != "ground":
            mend = "two bodies, or a plane of the ground, can touch; divide the body, and join its parts"
            raise FaultError(f"are faces of one body, which can't touch itself; {mend}", "between")
        if self.on_ground and self.normal is None:
            raise FaultError("is missing: the direction out of the ground, such as [0, 0, 1]", "normal")
        if not self.on_ground and self.normal is not None:
            raise FaultError("belongs to a plane of the ground; faces of bodies have normals of their own", "normal")
        if not self.on_ground and self.near_field == "half-space":
            raise FaultError("is for planes of the ground; 'mesh' works between bodies", "near_field")

    @property
    def has_memory(self) -> bool:
        """True if its forces follow from more than positions."""
        return self.friction > 0.0 or self.damping > 0.0 or self.restitution < 1.0

    @property
    def on_ground(self) -> bool:
        """True if a plane of the ground is touched."""
        return any(end.partition(".")[0] == "ground" for end in self.between)


def check_bodies(
    contacts: Mapping[str, Contact], pieces: Collection[str], flexible: Collection[str], triangles: Collection[str]
) -> Iterator[FaultError]:
    """Yield faults of contacts with bodies in pieces, or of another damping or restitution than others allow.

    Rigid bodies' surfaces of triangles are as faces of flexible ones.
    """
    of_body: dict[str, tuple[str, float]] = {}
    for name, contact in contacts.items():
        bodies = sorted({end.partition(".")[0] for end in contact.between} - {"ground"})
        for body in bodies:
            if body in pieces:
                yield FaultError(
                    f"touches with {body}, which is in pieces; pieces = 1 works", "contact", name, "between"
                )
            if body not in flexible and not any(
                end in triangles for end in contact.between if end.startswith(f"{body}.")
            ):
                continue
            if contact.restitution != 1.0:
                fault = (
                    f"is for round rigid surfaces alone: {body} bounces by its flexibility; damping takes energy, too"
                )
                yield FaultError(fault, "contact", name, "restitution")
            other, damping = of_body.setdefault(body, (name, contact.damping))
            if damping != contact.damping:
                fault = f"isn't that of contact.{other}, {damping:g} s, which has {body} in common with it"
                yield FaultError(fault, "contact", name, "damping")


def check_faces(contacts: Mapping[str, Contact], flexible: Collection[str]) -> Iterator[FaultError]:
    """Find contacts that aren't between the ground and a body or between two, and faces that have one already.

    A rigid surface may touch several planes.
    """
    taken: dict[tuple[Any, ...], str] = {}
    for name, contact in contacts.items():
        first, second = (end.partition(".")[0] for end in contact.between)
        if contact.on_ground and (first != "ground" or second == "ground"):
            mend = (
                "'ground' or a place on it first, where a plane is, and a face of a flexible body, or a surface of a "
            )
            mend += "rigid one, second"
            yield FaultError(f"must be {mend}", "contact", name, "between")
        faces: tuple[Any, ...] = tuple(sorted(end for end in contact.between if end.partition(".")[0] != "ground"))
        if contact.on_ground and second not in flexible:
            faces = *contact.between, contact.normal
        if faces in taken:
            mend = "a face touches one plane, and two faces make one contact; join them, or name parts of faces"
            yield FaultError(f"has the face of contact.{taken[faces]}; {mend}", "contact", name, "between")
        taken[faces] = name


def check_wear_picture(
    output: ContactPressure, contact: Contact, flexible: Collection[str], number: int
) -> Iterator[FaultError]:
    """Check that what a picture of wear is to show wears."""
    if output.quantity == "wear" and contact.wear == 0.0:
        fault = f"needs the contact's wear, e.g. contact.{output.contact}.wear = '1e-14 1/Pa'"
        yield FaultError(fault, "output", number, "quantity")
    bodies = [body for end in contact.between if (body := end.partition(".")[0]) in flexible]
    if output.body is not None and output.body not in bodies:
        yield UnknownNameError("body", output.body, bodies, "flexible bodies of the contact", "output", number, "body")


def check_surface(place: str, surfaces: Collection[str], contact: Contact, *path: str | int) -> Iterator[FaultError]:
    """Check a place on a rigid body that touches something: one of its surfaces."""
    body, _, surface = place.partition(".")
    if not surfaces:
        mend = f"give it one, e.g. [body.{body}.surface.skin] with type = 'ball', radius, E and nu"
        yield FaultError(f"touches with {body}, a rigid body without a surface; {mend}", *path)
    elif surface not in surfaces:
        yield UnknownNameError("surface", place, [f"{body}.{own}" for own in surfaces], "the surfaces", *path)
    if contact.near_field == "half-space" or contact.width is not None:
        key = "width" if contact.width is not None else "near_field"
        yield FaultError("is for faces of flexible bodies; round rigid surfaces have laws of their own", *path[:2], key)
