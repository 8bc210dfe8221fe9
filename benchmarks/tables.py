"""Write the measured tables of ``docs/`` from the CSV files of this folder.

Run from the project's root after a benchmark: ``python benchmarks/tables.py``. A table stands in its page between the
lines ``<!-- table: NAME -->`` and ``<!-- end -->``, NAME being one of `TABLES`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from math import exp, inf, isfinite, log
from pathlib import Path
from statistics import median

HERE = Path(__file__).parent
sys.path.append(str(HERE))
from auto_tables import auto_choice, auto_error, truth  # noqa: E402 - beside this file
from fmu_table import fmu  # noqa: E402 - beside this file
from loop_tables import loops  # noqa: E402 - beside this file
from pieces_tables import (  # noqa: E402 - beside this file
    large_deflection,
    nonlinear_modes,
    pendulum,
    piece_sections,
    spin_up_pieces,
)
from speed_tables import compiling, march_flops, march_speed, variants  # noqa: E402 - beside this file
from table_format import Row, format_ratio, format_seconds, markdown, read_rows  # noqa: E402

DOCS = HERE.parent / "docs"
SLOT = re.compile(r"(<!-- table: ([\w-]+) -->\n)(.*?)(<!-- end -->)", re.DOTALL)
Points = list[tuple[float, float]]

SCENES = ("rod-slider", "beam", "beam-20-modes", "beam-60-modes", "arm", "robot")
TIP_ERRORS = (1e-3, 1e-6)
METHODS = (
    "central-difference",
    "sub-cycling 5:1",
    "sub-cycling 10:1",
    "generalized-alpha",
    "exponential",
    "exponential-rosenbrock",
    "runge-kutta",
    "Radau",
    "LSODA",
    "heyoka",
    "Exudyn GeneralizedAlpha",
    "Exudyn TrapezoidalIndex2",
    "Exudyn VelocityVerlet",
    "Exudyn RK44",
    "Exudyn RK67",
)
FACTOR = 5.0  # an error budget within this factor of the true error counts as near
LATER = ("further", "propeller, quadratic")  # cases that were added when the estimates had been made
ELEMENTS = ("cantilevers", "propeller", "hexahedra", "tetrahedra")
ENERGY_KEEPING = ("central-difference", "reversible-sub-cycling")


def seconds_at(points: Points, error: float) -> float:
    """Return the least seconds for an error, interpolated in logarithms; infinite if it isn't reached."""
    times = [points[0][0]] if points[0][1] <= error else []
    for (s0, e0), (s1, e1) in pairwise(points):
        if e1 <= error < e0:
            share = (log(e0) - log(error)) / (log(e0) - log(e1))
            times.append(exp(log(s0) + share * (log(s1) - log(s0))))
    return min(times, default=inf)


def integrators() -> str:
    """Tabulate the seconds of each method for two errors of the tip, the fastest in bold."""
    columns = []
    for scene in SCENES:
        points: dict[str, Points] = {}
        for row in read_rows(scene):
            points.setdefault(row["integrator"], []).append((float(row["seconds"]), float(row["error"])))
        for error in TIP_ERRORS:
            seconds = [seconds_at(points[method], error) if method in points else inf for method in METHODS]
            best = min(seconds)
            cells = [f"**{format_seconds(s)}**" if s == best else format_seconds(s) for s in seconds]
            columns.append([f"{scene}, {error:.0e}", *cells])
    header, *rows = zip(*columns, strict=True)
    return markdown(["error of the tip", *header], ([m, *row] for m, row in zip(METHODS, rows, strict=True)))


def beam_subcycling() -> str:
    """Tabulate run time and errors of the beam with sub-cycling against plain central difference."""
    header = ("method", "time", "over plain", "tip's deflection off by", "tip in space off by", "angle off by")
    rows = (
        [
            row["method"],
            f"{row['median_ms']} ms",
            row["ratio"],
            f"{row['tip_deflection_error_um']} µm",
            f"{row['tip_position_error_um']} µm",
            f"{row['joint_angle_error_urad']} µrad",
        ]
        for row in read_rows("beam_subcycling")
    )
    return markdown(header, rows)


def propeller() -> str:
    """Tabulate run time and stress of the propeller with sub-cycling against plain central difference."""
    rows = []
    for row in read_rows("propeller"):
        if match := re.fullmatch(r"(\S+), sub-cycling (\S+) over plain, run time", row["what"]):
            share = float(row["figures"].split()[0])
            rows.append([match[1], match[2], row["ratio"], f"{100 * share:.2g} %"])
    return markdown(("scene", "ratio of steps", "time over plain", "largest stress off plain's by"), rows)


def meshes() -> str:
    """Tabulate the fastest mesh of each element within 0.1 % in frequency, or the most accurate one that was tried."""
    by_element: dict[tuple[str, str], list[Row]] = {}
    for row in read_rows("modes"):
        by_element.setdefault((row["scene"], row["element"]), []).append(row)
    rows = []
    for (scene, element), tried in by_element.items():
        within = [row for row in tried if float(row["error"]) <= 1e-3]
        by_time, by_error = (lambda row: float(row["seconds"])), (lambda row: float(row["error"]))
        best = min(within, key=by_time) if within else min(tried, key=by_error)
        rows.append(
            [
                scene,
                element,
                best["mesh"],
                f"{int(best['unknowns']):,}",
                f"{float(best['seconds']):.2g} s",
                f"{100 * float(best['error']):.2g} %",
            ]
        )
    return markdown(("part", "element", "mesh", "unknowns", "assembly and modes", "largest error of a frequency"), rows)


def stability() -> str:
    """Tabulate the outcome of the long marches for each family of systems."""
    families: dict[str, list[Row]] = {}
    for row in read_rows("stability"):
        families.setdefault(row["family"], []).append(row)
    rows = []
    for family, marches in families.items():
        cycles = [n for row in marches if (n := int(row["cycles"]))]
        drifts = [
            abs(float(row["drift"]))
            for row in marches
            if row["found"] == "lives" and row["integrator"] in ENERGY_KEEPING and row["drift"] != "nan"
        ]
        rows.append(
            [
                family,
                f"{len(marches)}",
                f"{min(cycles):,} … {max(cycles):,}" if min(cycles) < max(cycles) else f"{max(cycles):,}",
                f"{sum(row['found'] == 'lives' for row in marches)}",
                f"{sum(row['found'] == 'diverges' for row in marches)}",
                f"{sum(row['predicted'] == 'either' for row in marches)}",
                f"{sum(int(row['wrong']) for row in marches)}",
                "has dampers" if family == "arm" else f"{max(drifts):.1e}",
            ]
        )
    return markdown(
        (
            "systems",
            "marches",
            "major cycles each",
            "stayed bounded",
            "diverged",
            "too close to call",
            "predicted wrongly",
            "largest drift of energy, central difference and reversible",
        ),
        rows,
    )


def whole_runs() -> str:
    """Tabulate the seconds of whole runs, cold and warm, by what they are spent on."""
    groups = {
        "motion, with compiling": ("motion",),
        "pictures": ("pictures",),
        "start, imports and the rest": ("start, imports and the rest",),
        "error budget": ("error budget",),
    }
    runs: dict[tuple[str, str], dict[str, Row]] = {}
    for row in read_rows("pipeline"):
        runs.setdefault((row["scene"], row["run"]), {})[row["stage"]] = row
    rows = []
    for (scene, run), stages in runs.items():
        seconds = {name: float(row["seconds"]) for name, row in stages.items()}
        shares = [sum(seconds.get(name, 0.0) for name in names) for names in groups.values()]
        rest = seconds["whole"] - sum(shares)
        memory = float(stages["whole"]["megabytes"]) / 1000
        rows.append(
            [f"{scene}, {run}", *(f"{abs(s):.1f}" for s in (seconds["whole"], *shares, rest)), f"{memory:.1f} GB"]
        )
    return markdown(("run", "whole", *groups, "mesh to modal stress, files", "peak memory"), rows)


def eigen() -> str:
    """Tabulate the time and memory of twenty modes of a block in several programs."""
    rows, own = [], 1.0
    for row in read_rows("eigen_peers"):
        total = float(row["total"] or "nan")
        own = total if row["program"] == "fmd" else own
        cells = [f"{float(row[key]):.3g}" if row[key] else "" for key in ("assemble", "factor", "iterate")]
        memory = f"{float(row['memory_mb']):,.0f} MB" if row["memory_mb"] else ""
        times = [f"{total:.3g}", f"{total / own:.2g}"] if isfinite(total) else ["–", "–"]
        rows.append([f"{int(row['unknowns']):,}", row["program"], *cells, *times, memory, row["digits"], row["note"]])
    header = ("unknowns", "program", "assemble", "factor", "iterate", "all", "over fmd")
    return markdown((*header, "peak memory", "digits in common", "remark"), rows)


def assembly() -> str:
    """Tabulate the time of assembling stiffness and mass, other packages' over ours."""
    blocks: dict[tuple[str, str], dict[str, Row]] = {}
    for row in read_rows("assembly"):
        package = re.sub(r" [\d.]+", "", row["package"])
        blocks.setdefault((row["element"], row["unknowns"]), {})[package] = row
    packages = list(dict.fromkeys(package for block in blocks.values() for package in sorted(block)))
    others = [package for package in packages if package != "fmd"]
    rows = (
        [
            element,
            f"{int(unknowns):,}",
            f"{float(block['fmd']['seconds']):.2g} s",
            *(f"{format_ratio(float(block[name]['over fmd']))} ×" if name in block else "–" for name in others),
        ]
        for (element, unknowns), block in blocks.items()
    )
    return markdown(("element", "unknowns", "fmd", *others), rows)


def error_budget() -> str:
    """Tabulate how often the stated error covers the true one, and how often it is within a factor of five."""
    cases: dict[str, list[Row]] = {}
    for row in read_rows("error_budget"):
        cases.setdefault(row["scene"], []).append(row)
    first = [
        row for name, rows in cases.items() if name not in LATER and not name.startswith("further") for row in rows
    ]
    cases |= {"all but the later ones": first, "all": [row for rows in cases.values() for row in rows]}

    def share_of(rows: list[Row], least: float, most: float) -> str:
        inside = [least * float(r["true"]) <= float(r["stated"]) <= most * float(r["true"]) for r in rows]
        return f"{100 * sum(inside) / len(inside):.0f} % of {len(inside)}"

    lines = (
        [
            name,
            share_of(rows, 1.0, inf),
            share_of(rows, 1.0, FACTOR),
            share_of([row for row in rows if row["by_chance"] == "False"], 1.0, FACTOR),
        ]
        for name, rows in cases.items()
    )
    header = ("case", "true error below the stated one", "stated one within a factor of 5")
    return markdown((*header, "the same without true errors that are small by chance"), lines)


def error_sources() -> str:
    """Tabulate the medians of stated over true errors by source and kind of result."""
    groups: dict[tuple[str, str], list[float]] = {}
    for row in read_rows("error_sources"):
        ratio = float(row["stated"]) / float(row["true"])
        groups.setdefault((row["source"], row["kind"]), []).append(ratio)
        groups.setdefault((row["source"], "all"), []).append(ratio)
    lines = []
    for source in dict.fromkeys(source for source, _ in groups):
        kinds = sorted(kind for owner, kind in groups if owner == source and kind != "all")
        for kind in (*kinds, "all"):
            ratios = groups[source, kind]
            covered = f"{100 * sum(ratio >= 1 for ratio in ratios) / len(ratios):.0f} % of {len(ratios)}"
            lines.append([source, kind, f"{median(ratios):.1f}", covered])
    return markdown(("source", "results", "median of stated over true", "true below stated"), lines)


def deflection() -> str:
    """Tabulate stated and true errors of large deflections, in percent."""
    deflections: dict[tuple[str, str], dict[str, str]] = {}
    for row in read_rows("deflection"):
        stated, true = (100 * float(row[key]) for key in ("stated", "true"))
        line = deflections.setdefault((row["reference"], row["deflection"]), {})
        line[row["quantity"]] = f"{stated:.2g} for {true:.2g}"
    quantities = ("tip, deflection", "tip, largest deflection", "strip, largest von Mises stress")
    lines = (
        [reference, f"{100 * float(size):g} %", *(line.get(quantity, "–") for quantity in quantities)]
        for (reference, size), line in deflections.items()
    )
    return markdown(("reference", "of the length", "deflection [%]", "its size [%]", "stress [%]"), lines)


def as_written(name: str) -> str:
    """Tabulate a CSV file as it stands."""
    rows = read_rows(name)
    return markdown(rows[0], (row.values() for row in rows))


TABLES: dict[str, Callable[[], str]] = {
    "large-deflection": large_deflection,
    "pendulum": pendulum,
    "piece-sections": piece_sections,
    **{f"nonlinear-{case}": partial(nonlinear_modes, case) for case in ("plane", "space", "release")},
    "spin-up-pieces": spin_up_pieces,
    "integrators": integrators,
    "beam-subcycling": beam_subcycling,
    "propeller": propeller,
    "meshes": meshes,
    "stability": stability,
    "whole-runs": whole_runs,
    "march-speed": march_speed,
    "variants": variants,
    "march-flops": march_flops,
    "compiling": compiling,
    "eigen": eigen,
    "assembly": assembly,
    "error-budget": error_budget,
    "error-sources": error_sources,
    "deflection": deflection,
    "start": partial(as_written, "start"),
    "envelope": partial(as_written, "envelope"),
    **{f"elements-{part}": partial(as_written, f"elements-{part}") for part in ELEMENTS},
    "truth": truth,
    "loops": lambda: loops(seconds_at, TIP_ERRORS),
    "auto-choice": auto_choice,
    "auto-error": auto_error,
    "fmu": fmu,
}


def fill_tables(page: str) -> str:
    """Return a page's text with its tables made anew.

    Raises
    ------
    KeyError
        The page names a table that isn't in `TABLES`.
    """
    return SLOT.sub(lambda slot: slot[1] + "\n" + TABLES[slot[2]]() + "\n" + slot[4], page)


def main() -> None:
    """Write the tables of all pages, and move the charts that a benchmark left in this folder beside them."""
    for chart in HERE.glob("*.png"):
        chart.replace(DOCS / "charts" / chart.name)
    for path in sorted(DOCS.glob("*.md")):
        page = path.read_text(encoding="utf-8")
        if page != (filled := fill_tables(page)):
            path.write_text(filled, encoding="utf-8")
            print(f"{path.relative_to(HERE.parent)} has new tables")


if __name__ == "__main__":
    main()
