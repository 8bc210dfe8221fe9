"""Layers of shells in a scene file: plies of orthotropic materials, their angles and their strengths."""

from pydantic import Field

from fmd.core.units import Angle, Length, PositiveDensity, PositiveLength, PositiveStress
from fmd.scene.bodies import Solid
from fmd.scene.reading import FaultError, SceneTable, UnknownNameError, example_of_key, raise_faults
from fmd.scene.values import Axis, Number, Poisson, Text


class PlyStrength(SceneTable):
    """Strengths of a ply in its own axes, each above 0.

    Example:

        [body.wing.lamina.carbon.strength]
        Xt = "1500 MPa"
        Xc = "1200 MPa"
        Yt = "50 MPa"
        Yc = "250 MPa"
        S = "70 MPa"
    """

    # Along the fibres, in tension and in compression [Pa].
    Xt: PositiveStress
    Xc: PositiveStress
    # Across them [Pa].
    Yt: PositiveStress
    Yc: PositiveStress
    S: PositiveStress  # In shear in the plane [Pa].


class LaminaTable(SceneTable):
    """Orthotropic material of plies: 1 is along the fibres, 2 across them in the ply, 3 through it.

    Example:

        [body.wing.lamina.carbon]
        E1 = "135 GPa"
        E2 = "10 GPa"
        nu12 = 0.3
        G12 = "5 GPa"
        G23 = "3.5 GPa"
        rho = "1550 kg/m^3"
    """

    # Young's moduli [Pa].
    E1: PositiveStress
    E2: PositiveStress
    nu12: Number  # Contraction along 2 over stretch along 1, below ``(E1/E2)^½``.
    G12: PositiveStress  # Shear modulus in the ply's plane [Pa].
    # Shear moduli through the thickness [Pa]; ``G12`` by default.
    G13: PositiveStress | None = None
    G23: PositiveStress | None = None
    rho: PositiveDensity  # Density [kg/m³].
    strength: PlyStrength | None = None  # Strengths, for failure indices.

    def _check(self) -> None:
        if not self.nu12**2 < self.E1 / self.E2:
            raise FaultError(f"must be below (E1/E2)^½ = {(self.E1 / self.E2) ** 0.5:.3g} by size", "nu12")


class Layer(SceneTable):
    """A ply of a laminate.

    Example:

        [[body.wing.layers]]
        material = "carbon"
        thickness = "0.125 mm"
        angle = "45 deg"
    """

    material: Text  # Its material, a name of the body's ``lamina``.
    thickness: PositiveLength  # Of the ply [m].
    angle: Angle = 0.0  # From ``layer_direction`` to the fibres, about the shell's normal [rad].


class Layerable(Solid):
    """Keys of bodies that may be shells of layers."""

    # Young's modulus [Pa]; a body of layers has those of its ``lamina``.
    E: PositiveStress | None = None  # type: ignore[assignment]
    # Poisson's ratio.
    nu: Poisson | None = None  # type: ignore[assignment]
    # Density [kg/m³].
    rho: PositiveDensity | None = None  # type: ignore[assignment]
    # Materials of plies, by name; for a deck's PCOMP and COMPOSITE the number or name of the material there.
    lamina: dict[Text, LaminaTable] = Field(default_factory=dict)
    layers: tuple[Layer, ...] = ()  # Plies from the shell's lower face to the upper one.
    # Vector whose projection onto the shell is the direction from which angles count.
    layer_direction: Axis = (1.0, 0.0, 0.0)
    offset: Length = 0.0  # Distance of the shell's middle from its midsurface as given, along the normal [m].

    @property
    def layered_thickness(self) -> float:
        """Thickness of all layers [m]."""
        return sum(layer.thickness for layer in self.layers)

    @property
    def has_own_layers(self) -> bool:
        """True if its plies are in the scene or in its deck, so that it needs no other material."""
        return bool(self.layers)

    def _check(self) -> None:
        for number, layer in enumerate(self.layers):
            if layer.material not in self.lamina:
                raise UnknownNameError(
                    "material", layer.material, self.lamina, "the lamina", "layers", number, "material"
                )
        missing = [key for key in ("E", "nu", "rho") if getattr(self, key) is None]
        if not self.has_own_layers:
            raise_faults(FaultError(f"is missing{example_of_key(Solid, key)}", key) for key in missing)
            if self.lamina:
                raise FaultError("has no effect: its materials are those of layers", "lamina")
        elif self.layers and len(missing) < 3:
            key = next(key for key in ("E", "nu", "rho") if key not in missing)
            raise FaultError("has no effect beside layers, which have the materials of lamina", key)
        if not self.layers and "layer_direction" in self.model_fields_set:
            raise FaultError(
                "has no effect: it belongs to layers, and those of a deck have their own", "layer_direction"
            )
