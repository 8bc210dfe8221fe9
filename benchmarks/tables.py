"""Write the measured tables of ``docs/`` from the CSV files of this folder.

Run from the project's root after a benchmark: ``python benchmarks/tables.py``. A table stands in its page between the
lines ``<!-- table: NAME -->`` and ``<!-- end -->``, NAME being one of `TABLES`.
"""

import re
import sys
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from math import exp, inf, isfinite, isnan, log
from pathlib import Path

HERE = Path(__file__).parent
sys.path.append(str(HERE))
from accuracy_tables import (  # noqa: E402 - beside this file
    auto_choice,
    auto_error,
    clamps,
    deflection,
    error_sources,
    meshes,
    stability,
    truth,
    truth_pairs,
)
from table_format import (  # noqa: E402
    SAME_DERIVATIVE,
    Row,
    format_ratio,
    format_seconds,
    group_rows,
    listed,
    markdown,
    read_rows,
)

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
ELEMENTS = ("cantilevers", "propeller")
OF_MOTION = ("mechanism", "equations", "machine code", "start", "steps", "plans", "stability", "motion", "fine motion")
PEER = "Exudyn"


def points_of(marches: list[Row]) -> Points:
    """Return the seconds and errors of marches."""
    return [(float(row["seconds"]), float(row["error"])) for row in marches]


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
        points = {name: points_of(rows) for name, rows in group_rows(read_rows(scene), "integrator").items()}
        for error in TIP_ERRORS:
            seconds = [seconds_at(points[method], error) if method in points else inf for method in METHODS]
            best = min(seconds)
            cells = [f"**{format_seconds(s)}**" if s == best else format_seconds(s) for s in seconds]
            columns.append([f"{scene}, {error:.0e}", *cells])
    header, *rows = zip(*columns, strict=True)
    return markdown(["error of the tip", *header], ([m, *row] for m, row in zip(METHODS, rows, strict=True)))


def loops() -> str:
    """Tabulate mechanisms with loops: the fastest method of ours beside Exudyn's fastest, for each error."""
    rows = []
    for scene, methods in group_rows(read_rows("loops"), "scene").items():
        points = {name: points_of(marches) for name, marches in group_rows(methods, "integrator").items()}
        for error in TIP_ERRORS:
            times = {name: seconds_at(found, error) for name, found in points.items()}
            own = {name: time for name, time in times.items() if not name.startswith(PEER)}
            peer = min((time for name, time in times.items() if name.startswith(PEER)), default=inf)
            best = min(own, key=lambda name: own[name])
            ratio = f"{format_ratio(peer / own[best])} ×" if isfinite(peer) else "–"
            rows.append([scene, f"{error:.0e}", best, format_seconds(own[best]), format_seconds(peer), ratio])
    return markdown(("mechanism", "error", "fastest of ours", "time", "Exudyn's", "ratio"), rows)


def peers() -> str:
    """Tabulate least times of ours and of other programs that took turns; a dash where an error isn't reached."""
    rows = []
    for row in read_rows("peers"):
        ratio, error = float(row["ratio"]), f"{row['error']:.0e}" if row["error"] else "–"
        ahead = "not reached" if isnan(ratio) else "ahead" if ratio > 1.0 else "not ahead"
        times = [format_seconds(float(row[key])) for key in ("seconds", "peer_seconds")]
        shown = "–" if isnan(ratio) else f"{format_ratio(ratio)} ×"
        rows.append([row["what"], error, row["method"], times[0], row["peer"], times[1], shown, ahead])
    return markdown(("mechanism", "error", "ours", "time", "peer", "its time", "over ours", "ours is"), rows)


def subcycling() -> str:
    """Tabulate run time and error of whole scenes with sub-cycling; no ratio that is within the spread."""
    rows = []
    for row in read_rows("subcycling"):
        ratio, spread = float(row["ratio"]), float(row["spread"])
        shown = f"{ratio:.2f}" if row["method"] == "central-difference" or abs(ratio - 1.0) > spread else "–"
        times = [format_seconds(float(row["seconds"])), f"{100 * spread:.0f} %"]
        rows.append([row["scene"], row["method"], *times, shown, f"{float(row['error']):.1e}"])
    return markdown(("scene", "method", "time", "median above", "over plain", "error"), rows)


def whole_runs() -> str:
    """Tabulate the seconds of whole runs, cold and warm, by what they are spent on."""
    groups = {
        "motion and stability, with compiling": OF_MOTION,
        "pictures": ("pictures",),
        "start, imports and the rest": ("start, imports and the rest",),
        "error budget": ("error budget",),
    }
    rows = []
    for (scene, run), of_run in group_rows(read_rows("pipeline"), "scene", "run").items():
        stages = {row["stage"]: row for row in of_run}
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
        cells = [f"{row[key]:.3g}" if row[key] else "" for key in ("assemble", "factor", "iterate")]
        memory = f"{row['memory_mb']:,.0f} MB" if row["memory_mb"] else ""
        times = [f"{total:.3g}", f"{total / own:.2g}"] if isfinite(total) else ["–", "–"]
        rows.append([f"{row['unknowns']:d}", row["program"], *cells, *times, memory, row["digits"], row["note"]])
    header = ("unknowns", "program", "assemble", "factor", "iterate", "all", "over fmd")
    return markdown((*header, "peak memory", "digits in common", "remark"), rows)


def assembly() -> str:
    """Tabulate the time of assembling stiffness and mass, other packages' over ours."""
    rows = [row | {"package": re.sub(r" [\d.]+", "", row["package"])} for row in read_rows("assembly")]
    blocks = group_rows(rows, "element", "unknowns")
    ordered = [name for block in blocks.values() for name in sorted(row["package"] for row in block)]
    others = [package for package in dict.fromkeys(ordered) if package != "fmd"]
    lines = []
    for (element, unknowns), block in blocks.items():
        by_package = {row["package"]: row for row in block}
        ratios = [f"{by_package[name]['over fmd']:r} ×" if name in by_package else "–" for name in others]
        lines.append([element, f"{int(unknowns):,}", f"{by_package['fmd']['seconds']:.2g} s", *ratios])
    return markdown(("element", "unknowns", "fmd", *others), lines)


def march_speed() -> str:
    """Tabulate the time of a step, or of an adaptive method's evaluation, and the earlier version's over it."""
    rows = read_rows("march_speed")
    scenes = list(group_rows(rows, "scene"))

    def cell(row: Row | None) -> str:
        return f"{format_seconds(1e-9 * float(row['now_ns']))}, {row['ratio']:r} ×" if row else "–"

    cells = {method: {row["scene"]: row for row in own} for method, own in group_rows(rows, "method").items()}
    return markdown(("method", *scenes), ([name, *(cell(own.get(s)) for s in scenes)] for name, own in cells.items()))


def march_flops() -> str:
    """Tabulate the operations of a step of central differences and their rate beside a dense product's."""
    cells = []
    for row in read_rows("march_speed"):
        if row["flops"]:
            product = f"{float(row['gflop_s']) / float(row['of_dgemm']):.0f}"
            cells.append([row["scene"], row["coordinates"], f"{row['flops']:d}", f"{row['gflop_s']:.2g}", product])
    return markdown(("mechanism", "coordinates", "operations a step", "Gflop/s", "a dense product's, same run"), cells)


def derivatives() -> str:
    """Tabulate run times of marches with derivatives, beside those without."""
    columns = {"scene": "{scene}", "coordinates": "{coordinates}", "a step": "{step_ns:.0f} ns"}
    columns |= {"eight tangents": "{tangents:r}", "by dimensions": "{by_dimensions:r}"}
    return listed("derivatives", columns | {"adjoint": "{adjoint:r}"})


def gradients() -> str:
    """Tabulate run times of whole gradients by the adjoint, over those by tangents."""
    columns = {"numbers": "{numbers}", "springs, dampers, rests": "{springs:r}"}
    return listed("gradients", columns | {"masses, centres, inertias": "{masses:r}"})


def random_derivatives() -> str:
    """Tabulate derivatives of random scenes by methods: how many, and the worst of each figure."""
    groups = group_rows((row for row in read_rows("random_derivatives") if not row["remark"]), "method")
    cells = []
    for method, rows in groups.items():
        exact = [row for row in rows if float(row["apart"]) <= SAME_DERIVATIVE]
        stated = [row for row in rows if float(row["apart"]) <= float(row["noise"]) + float(row["stated"])]
        worst = max(rows, key=lambda row: float(row["apart"]))
        adjoints = [float(row["adjoint"]) for row in rows if row["adjoint"] != "nan"]
        own = [f"{float(worst[name]):.0e}" for name in ("apart", "noise", "stated")]
        within = len({row["seed"] for row in (*exact, *stated)})
        adjoint = f"{max(adjoints):.0e}" if adjoints else "–"
        cells.append([method, str(len(rows)), str(len(exact)), str(within), *own, adjoint])
    head = ("method", "scenes", "within 1e-8", "or noise and stated error", "worst", "its differences' noise")
    return markdown((*head, "its stated error", "adjoint from tangents"), cells)


def fmu() -> str:
    """Tabulate errors by way and tolerance, sizes and run time of the scenes' FMUs."""

    def error(way: str) -> Callable[[Row], str]:
        return lambda row: f"{max(float(row[f'{way}_fmi2']), float(row[f'{way}_fmi3'])):.1e}"

    ways = {"cs_1e-06": "co-simulation at 1e-6", "cs_1e-09": "1e-9", "cs_1e-12": "1e-12", "me": "model exchange"}
    rows = [row | {way: error(way)(row) for way in ways} for row in read_rows("fmu")]
    columns = {"scene, modes": "{scene}, {modes}"} | {name: f"{{{way}}}" for way, name in ways.items()}
    columns |= {"FMI 2.0, 3.0 [kB]": "{kilobytes_fmi2}, {kilobytes_fmi3}"}
    return listed("fmu", columns | {"run time (ours)": "{fmu_s:t} ({fmd_s:t})", "ratio": "{ratio}"}, rows)


def large_deflection() -> str:
    """Tabulate statics of parts in pieces: errors and times."""
    rows = [
        row | {"second order": "no" if row["stiffening"] == "off" else "yes"} for row in read_rows("large_deflection")
    ]
    same = {name: f"{{{name}}}" for name in ("case", "pieces", "second order", "coordinates")}
    return listed(
        "large_deflection",
        same | {"error": "{error_percent} %", "warm statics": "{seconds:t}", "beside": "{note}"},
        rows,
    )


def as_written(name: str) -> str:
    """Tabulate a CSV file as it stands."""
    rows = read_rows(name)
    return markdown(rows[0], (row.values() for row in rows))


TABLES: dict[str, Callable[[], str]] = {
    "shells": partial(
        listed,
        "shells",
        {"case": "{case}", "element": "{element}"} | {f"{n} × {n}": f"{{n{n}}}" for n in (4, 8, 16, 32)},
    ),
    "large-deflection": large_deflection,
    "integrators": integrators,
    "subcycling": subcycling,
    "meshes": meshes,
    "stability": stability,
    "whole-runs": whole_runs,
    "march-speed": march_speed,
    "march-flops": march_flops,
    "compiling": partial(
        listed,
        "compiling",
        {
            "scene": "{scene}",
            "coordinates": "{coordinates}",
            "functions": "{functions}",
            "processor time": "{seconds} s",
        },
    ),
    "sweep-points": partial(
        listed,
        "sweep_points",
        {
            "scene": "{scene}",
            "varied": "`{varied}`",
            "all runs, summary": "1 ({all_runs_ms} ms)",
            "first run, summary": "{first_run:r}",
            "by name": "{by_name:r} (`{result}`)",
        },
    ),
    "contact-peers": partial(
        listed,
        "contact_peers",
        {
            "shock": "{case}",
            "program": "{tool}",
            "steps in it": "{steps}",
            "error of the speed after": "{speed_error}",
            "of the largest force": "{force_error}",
            "time": "{seconds:t}",
        },
    ),
    "contact-calculix": partial(
        listed,
        "contact_calculix",
        {
            "case": "{case}",
            "force [N]": "{force_N}",
            "CalculiX": "{calculix_force_N}",
            "mean pressure [MPa]": "{mean_MPa}",
            "CalculiX, mean": "{calculix_mean_MPa}",
            "largest pressure [MPa]": "{largest_MPa}",
            "CalculiX, largest": "{calculix_largest_MPa}",
            "rms of nodes' differences, over the largest": "{rms_of_largest}",
        },
    ),
    "contact-oblique": partial(
        listed,
        "contact_oblique",
        {
            "march": "{march}",
            "mean force [N]": "{mean_force_N}",
            "rms of its difference, over the largest": "{pressing_rms}",
            "of the force aside": "{aside_rms}",
            "friction's work [J]": "{heat_J}",
            "processor time": "{seconds} s",
        },
    ),
    **{
        f"contact-{name}": partial(
            listed,
            f"contact_{name}",
            {
                "march": "{march}",
                "impulse outwards [N s]": "{impulse_Ns}",
                "friction's work [J]": "{heat_J}",
                "largest force [N]": "{largest_force_N}",
                "rms of its difference outwards, over the largest": "{outwards_rms}",
                "of the force around": "{around_rms}",
                "processor time": "{seconds} s",
            },
        )
        for name in ("rub", "rotor")
    },
    "gears": partial(
        listed,
        "gears",
        {
            "teeth": "{teeth}",
            "figure": "{figure}",
            "of ISO 6336": "{beside}",
            "ISO 6336": "{iso}",
            "here": "{fmd}",
            "on finer elements": "{finer}",
        },
    ),
    "gear-resonance": partial(
        listed,
        "gear_resonance",
        {
            "mesh's frequency over the natural one": "{ratio}",
            "speed of the pinion [1000 rpm]": "{speed_krpm}",
            "transmission error varies by [µm]": "{varies_um}",
            "largest force over the mean": "{force}",
            "apart [% of the time]": "{apart}",
        },
    ),
    "robots": partial(
        listed,
        "robots",
        {
            "robot": "{robot}",
            "from": "{source}",
            "joints": "{joints}",
            "links with moments that no body has": "{impossible}",
            "off by": "{off:.0e}",
            "beside": "{beside}",
        },
    ),
    "derivatives": derivatives,
    "gradients": gradients,
    "random-derivatives": random_derivatives,
    "eigen": eigen,
    "assembly": assembly,
    "error-sources": error_sources,
    "deflection": deflection,
    **{f"elements-{part}": partial(as_written, f"elements-{part}") for part in ELEMENTS},
    "clamps": clamps,
    "truth": truth,
    "truth-pairs": truth_pairs,
    "loops": loops,
    "peers": peers,
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
