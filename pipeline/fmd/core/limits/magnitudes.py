"""Magnitudes: what a quantity can be at all, beyond which it is refused, and what is usual, beyond which is warned."""

POSSIBLE = {
    "length": (1e-12, 1e12),
    "stress": (1e-9, 1e18),
    "density": (1e-9, 1e18),
    "time": (1e-18, 1e12),
    "frequency": (1e-12, 1e18),
    "mass": (1e-30, 1e18),
    "speed": (1e-30, 299_792_458.0),
}
"""Least size but 0 and greatest size of quantities by their kind, in SI units: between atoms and planets."""

ANY_SIZE = (1e-60, 1e60)  # of a quantity of any other kind, and of plain numbers: squares and cubes stay numbers

USUAL_OF_BODIES = {
    "E": (1e5, 1.3e12, "Pa", "rubber has about 1e6, steel 2.1e11, diamond 1.1e12"),
    "nu": (0.0, 0.495, "", "metals have about 0.3; of rubber nearly no volume change is left"),
    "rho": (10.0, 23_000.0, "kg/m^3", "foam has about 30, water 1000, steel 7850, osmium 22590"),
    "mass": (1e-9, 1e8, "kg", "a grain of sand has 1e-6, a ship 1e8"),
    "length": (1e-6, 1e4, "m", "a wind turbine's blade has 100"),
    "depth": (1e-7, 1e3, "m", "a sheet of paper has 1e-4"),
    "width": (1e-7, 1e3, "m", "a sheet of paper has 1e-4"),
    "diameter": (1e-6, 1e3, "m", "a wind turbine has 200"),
}
"""Usual values of keys of bodies: least, greatest, unit and examples."""

USUAL_OF_MOTION = {
    "angular rate": (2e4, "rad/s", "a turbocharger has 2e4, about 190 000 rpm"),
    "speed": (3e3, "m/s", "a rifle's bullet has 1e3"),
}
"""Greatest usual rates by the kind of quantity: size, unit and example."""

POOR_QUALITY = 0.05  # least scaled Jacobian of a usable mesh: thinner elements are stiff and their stress is wrong
LUMPING_COUNTS = 1e-3  # relative change of a frequency by lumped masses, from which on a run warns of it
