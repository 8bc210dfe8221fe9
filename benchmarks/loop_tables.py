"""Table of mechanisms with loops: the fastest method of ours beside Exudyn's fastest."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

from table_format import format_ratio, format_seconds, markdown, read_rows

PEER = "Exudyn"


def loops(seconds_at: Callable[[list[tuple[float, float]], float], float], errors: tuple[float, ...]) -> str:
    """Tabulate the seconds for each error of each mechanism; ``seconds_at`` interpolates (seconds, error) pairs."""
    by_scene: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for row in read_rows("loops"):
        points = by_scene.setdefault(row["scene"], {}).setdefault(row["integrator"], [])
        points.append((float(row["seconds"]), float(row["error"])))
    rows = []
    for scene, methods in by_scene.items():
        for error in errors:
            times = {name: seconds_at(points, error) for name, points in methods.items()}
            own = {name: time for name, time in times.items() if not name.startswith(PEER)}
            peer = min((time for name, time in times.items() if name.startswith(PEER)), default=float("inf"))
            best = min(own, key=lambda name: own[name])
            ratio = f"{format_ratio(peer / own[best])} ×" if isfinite(peer) else "–"
            rows.append([scene, f"{error:.0e}", best, format_seconds(own[best]), format_seconds(peer), ratio])
    return markdown(("mechanism", "error", "fastest of ours", "time", "Exudyn's", "ratio"), rows)
