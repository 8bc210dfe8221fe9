"""Cases of flexible bodies that turn: a rod's stretch, a cantilever's frequencies, Kane's spin-up."""

import numpy as np

from fmd.core.arrays import Array
from fmd.core.cache import Cache
from fmd.fem.material import Material
from fmd.output.frequencies import rotating_table
from fmd.stages.pipeline import Pipeline
from fmd.verification.case import Figure, VerificationCase, open_scene
from fmd.verification.closed_forms import stretched_rod

# First and second flapping frequency of a uniform cantilever at Ω √(μL⁴/EI) = η: Wright et al., table of the hub of no
# radius.
_FLAP = {
    0: (3.5160, 22.0345),
    2: (4.1373, 22.6149),
    4: (5.5850, 24.2734),
    6: (7.3604, 26.8091),
    8: (9.2568, 29.9954),
    10: (11.2023, 33.6404),
    12: (13.1702, 37.6031),
}
_OUT_OF_PLANE = 'body.beam.modes={count=8, family="out-of-plane bending", boundary="joint", enrich="none"}'
_ALL_AXIAL = 'body.rod.modes={count=1, family="axial", boundary="joint", enrich="inertia"}'


def _tip_displacement(run: Pipeline) -> tuple[Array, Array]:
    """Return the times of the first run, and the tip's displacement in the body's frame, (n_times, 3) [m]."""
    motion = run.motion
    return motion.times, motion.tip_displacement


def _rod(cache: Cache | None) -> list[Figure]:
    softened = open_scene("verification/rod", cache)
    material = softened.fe.material
    assert isinstance(material, Material)
    linear, nonlinear = stretched_rod(0.5, material, 3000.0)
    # Without spin softening: the static answer of the reduced body, enriched for it, to the load of its own shape.
    body = open_scene("verification/rod", cache, [_ALL_AXIAL]).part.body
    load = 3000.0**2 * (body.integrals.G[0, 0] + body.integrals.G[1, 1])[1:, 0]
    extension = float(body.markers["tip"].translation[0] @ (load / body.omega**2))
    tip = _tip_displacement(softened)[1][-1, 0]
    return [
        Figure("extension, load of the undeformed rod [m]", extension, linear, 1e-3),
        Figure("extension with spin softening [m]", float(tip), nonlinear, 1e-3),
    ]


def _flapping(cache: Cache | None) -> list[Figure]:
    run = open_scene("spin-up", cache, [_OUT_OF_PLANE])
    scale = np.sqrt(1.2 * 10.0**4 / 1.4e4)  # √(μL⁴/EI) of the scene
    figures = []
    for eta, published in _FLAP.items():
        ours = 2 * np.pi * scale * np.array(rotating_table(run, eta / scale)["rotating_frequencies_hz"])
        for k in range(2):
            figures.append(Figure(f"flap {k + 1} at η = {eta}", float(ours[k]), published[k], 5e-3))
    return figures


def _spin_up(cache: Cache | None) -> list[Figure]:
    times, tip = _tip_displacement(open_scene("spin-up", cache))
    along, across = tip[:, 0], np.abs(tip[:, 1])
    return [
        Figure("largest lag of the tip [m]", float(across.max()), 0.574, 0.02),
        Figure("its time [s]", float(times[across.argmax()]), 6.8, 0.02),
        Figure("extension at 6 rad/s [m]", float(along[times >= 15].mean()), 5.14e-4, 0.01),
    ]


_WRIGHT = "Wright et al., J Appl Mech 49 (1982)"
CASES = (
    VerificationCase("rotating-rod", "rod at 3000 rad/s", "ρΩ²L³/3E; (tan kL/kL − 1) L, k = Ω√(ρ/E)", _rod),
    VerificationCase("rotating-cantilever", "flapping of a cantilever", _WRIGHT, _flapping),
    VerificationCase("spin-up", "slender beam spun up", "Kane et al. (1987); Simo & Vu-Quoc (1986)", _spin_up),
)
