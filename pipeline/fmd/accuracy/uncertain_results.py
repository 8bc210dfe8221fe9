"""Warnings about results that the error budget states as uncertain, with the source and a remedy."""

from fmd.accuracy.error_budget import Budget
from fmd.accuracy.error_estimates import Row
from fmd.core.limits.errors import TOO_UNCERTAIN
from fmd.core.limits.shown import NAMED_RESULTS
from fmd.scene.scene import Scene
from fmd.scene.variants import replace_order

_OWN_WARNING = ("large deflection", "stretching", "stiffening left off")  # causes that every run warns of


def uncertain_warnings(scene: Scene, budget: Budget) -> list[dict[str, str]]:
    """Warn of results that are uncertain by more than `TOO_UNCERTAIN`, by source, and by cause if that is the model."""
    by_source: dict[str, list[Row]] = {}
    for row in sorted(budget.results(scene), key=lambda row: -row.numerical):
        if row.numerical > TOO_UNCERTAIN:
            by_source.setdefault(row.dominant, []).append(row)
    texts = [f"{_name(rows)}: {_source(source, scene)}" for source, rows in by_source.items()]
    for cause in budget.model:
        error = budget.safety * cause.error
        if cause.counted and cause.cause not in _OWN_WARNING and error > TOO_UNCERTAIN:
            texts.append(f"'{cause.quantity}' may be off by up to {100 * error:.0f} %: {cause.text}")
    corners = [{"code": each.code, "body": each.body, "text": each.warning} for each in budget.corners]
    return [*corners, *({"code": "uncertain-results", "text": text} for text in texts)]


def _name(rows: list[Row]) -> str:
    first, *others = (f"'{row.name}' {{}}{_amount(row)}" for row in rows[:NAMED_RESULTS])
    named = ", ".join([first.format("may be off "), *(text.format("") for text in others)])
    more = (
        f" and {len(rows) - NAMED_RESULTS} more by over {100 * TOO_UNCERTAIN:g} %" if len(rows) > NAMED_RESULTS else ""
    )
    return named + more


def _amount(row: Row) -> str:
    return "by an unknown amount" if row.why else f"by up to {100 * row.numerical:.0f} %"


def _source(source: str, scene: Scene) -> str:
    quadratic = replace_order(scene, 2).body
    coarse = [name for name, body in scene.flexible.items() if quadratic[name] != body]
    bodies = {name: scene.with_its_basis(name) for name in scene.flexible}
    bare = [name for name, body in bodies.items() if body.shape != "reduced" and body.modes.enrich == "none"]
    finer = f"order = 2 of [body.{coarse[0]}.mesh]" if coarse else "a finer mesh"
    of_files = not coarse and all(body.shape == "mesh" for body in scene.flexible.values())
    more = f'enrich = "inertia" of [body.{bare[0]}.modes]' if bare else "a larger modes.count"
    said = {
        "discretisation": f"the mesh is too coarse for that; {finer} helps",
        "recovery": f"the mesh is too coarse for stress; {finer} helps",
        "truncation": f"the modes leave too much out for that; {more} helps",
        "time": "the steps are too long for that; a smaller step, tolerance or simulation.error helps",
    }
    refines = scene.accuracy is None and not (of_files and source in ("discretisation", "recovery"))
    by_itself = "" if not refines else f', and accuracy = "{100 * TOO_UNCERTAIN:g} %" refines by itself'
    return said[source] + by_itself
