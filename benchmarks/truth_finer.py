"""References of random scenes by a much finer run of the same scene, marched by another tolerance or method."""

from pathlib import Path

from truth_parts import Table
from truth_references import number
from truth_scenes import Case

from fmd import Pipeline, load_scene
from fmd.core.errors import AccuracyError

MOST_RADIANS = 2e5  # of the highest frequency over a finer run that an explicit method marches
IMPLICIT_STEPS = 20_000  # of a finer run that is too stiff for it
# Modes more than the run has, over them (and eight), and settings: of a reference, and of those that take its place.
STIFFENED = "simulation.stiffening=on"
BASES: tuple[tuple[float, tuple[str, ...]], ...] = (
    (1.0, (STIFFENED, "modes.enrich=inertia")),
    (1.0, (STIFFENED, "modes.enrich=none")),
    (0.25, (STIFFENED,)),
    (0.25, ()),
)


def finer_run(file: Path, case: Case, run: Pipeline) -> Pipeline:
    """Return a scene with everything finer and stiffened, marched with a small tolerance or step.

    A basis of many shapes has combinations that move next to no mass, of which displacements of second order can take
    the last: where such a march fails, one of fewer shapes is tried, and one that stiffens what the run does.
    """
    failure: AccuracyError | None = None
    for more_modes, more in BASES if case.bars else ((0.0, ()),):
        try:
            return _marched(file, case, run, _finer(case, more_modes, more))
        except AccuracyError as error:
            failure = failure or error
    raise failure or AccuracyError("no reference")


def _finer(case: Case, more_modes: float, more: tuple[str, ...]) -> list[str]:
    """Return overrides of a scene for finer meshes, more modes, and settings of all bodies or of the simulation."""
    overrides = [each for each in more if each.startswith("simulation")]
    for name in case.bars:
        body = case.table["body"][name]
        overrides += [
            f"body.{name}.mesh={{{_finer_mesh(body['mesh'])}}}",
            f"body.{name}.modes.count={round((1 + more_modes) * body['modes']['count'] + 8 * more_modes)}",
        ]
        overrides += [f"body.{name}.{each}" for each in more if each.startswith("modes") and "pieces" not in body]
    return overrides


def _finer_mesh(mesh: Table) -> str:
    """Return elements of half the length, quadratic ones, of the same shape."""
    if "size" in mesh:
        return f'element="tetrahedron", order=2, size="{number(mesh["size"]) / 2!r} m"'
    along = mesh["divisions"][0]
    return f"order=2, divisions=[{2 * along if mesh['order'] == 2 else along}, 2, 2]"


def _marched(file: Path, case: Case, run: Pipeline, overrides: list[str]) -> Pipeline:
    """Return a finer scene with its motion.

    Raises
    ------
    AccuracyError
        There is no motion.
    """
    finer = Pipeline(load_scene(file, overrides), run.store.cache)
    duration = number(case.table["simulation"]["duration"])
    if not case.bars:
        method = 'integrator="LSODA", tolerance=1e-11'
    elif finer.system.highest_frequency * duration < MOST_RADIANS:
        method = 'integrator="runge-kutta", tolerance=1e-9'
    else:
        method = f'integrator="generalized-alpha", rho=0.9, step="{duration / IMPLICIT_STEPS} s"'
    variant = finer.variant(load_scene(file, [*overrides, f"simulation.run=[{{{method}}}]"]))
    try:
        variant.motion  # noqa: B018
    except AccuracyError:  # an implicit step without a solution
        if "alpha" not in method:
            raise
        method = 'integrator="runge-kutta", tolerance=1e-8'
        variant = finer.variant(load_scene(file, [*overrides, f"simulation.run=[{{{method}}}]"]))
        variant.motion  # noqa: B018
    return variant
