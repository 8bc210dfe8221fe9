"""Tables of errors: of meshes, stability, sources of error, ``auto`` and random scenes."""

from statistics import median
from types import SimpleNamespace

from table_format import Cell, Row, format_ratio, group_rows, listed, markdown, read_rows
from truth_features import pairwise_coverage

LONG = 60.0  # seconds of a run
FIRST_NEW = 400  # seed of random scenes from which on rows have ratios
ENERGY_KEEPING = ("central-difference", "reversible-sub-cycling")


def meshes() -> str:
    """Tabulate the fastest mesh of each element within 0.1 % in frequency, or the most accurate one that was tried."""
    best = []
    for tried in group_rows(read_rows("modes"), "scene", "element").values():
        within = [row for row in tried if float(row["error"]) <= 1e-3]
        key = "seconds" if within else "error"
        best.append(min(within or tried, key=lambda row: float(row[key])))
    columns = {
        "part": "{scene}",
        "element": "{element}",
        "mesh": "{mesh}",
        "unknowns": "{unknowns:d}",
        "assembly and modes": "{seconds:.2g} s",
        "largest error of a frequency": "{percent:.2g} %",
    }
    return listed("modes", columns, [row | {"percent": Cell(100 * float(row["error"]))} for row in best])


def stability() -> str:
    """Tabulate the outcome of the long marches for each family of systems."""
    rows = []
    for family, marches in group_rows(read_rows("stability"), "family").items():
        cycles = [n for row in marches if (n := int(row["cycles"]))]
        drifts = [
            abs(float(row["drift"]))
            for row in marches
            if row["found"] == "lives" and row["integrator"] in ENERGY_KEEPING and row["drift"] != "nan"
        ]
        found = [row["found"] for row in marches]
        counts = [found.count("lives"), found.count("diverges"), sum(row["predicted"] == "either" for row in marches)]
        counts.append(sum(int(row["wrong"]) for row in marches))
        over = f"{min(cycles):,} … {max(cycles):,}" if min(cycles) < max(cycles) else f"{max(cycles):,}"
        drift = "has dampers" if family == "arm" else f"{max(drifts):.1e}"
        rows.append([family, f"{len(marches)}", over, *map(str, counts), drift])
    header = ("systems", "marches", "major cycles each", "stayed bounded", "diverged", "too close to call")
    drifts = "largest drift of energy, central difference and reversible"
    return markdown((*header, "predicted wrongly", drifts), rows)


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


def auto_choice() -> str:
    """Run time of ``auto`` over the best method's at the same true error."""
    rows = read_rows("auto_choice")
    body = [
        [
            f"random {row['scene']}" if row["scene"].isdigit() else row["scene"],
            row["method"],
            f"{row['error']:.1e}",
            f"{row['seconds']:t}",
            f"{row['best']}, {row['best_seconds']:t}",
            f"{row['ratio']:r}",
            f"{row['wanted_best']}, {row['wanted_seconds']:t}",
            f"{row['wanted_ratio']:r}",
        ]
        for row in rows
    ]
    middle = [f"{median(float(row[key]) for row in rows):.2g}" for key in ("ratio", "wanted_ratio")]
    body.append(["median", "", "", "", "", middle[0], "", middle[1]])
    head = ["scene", "chosen", "true error", "`auto`", "best at that error", "ratio", "best at 1e-3", "ratio"]
    return markdown(head, body)


def auto_error() -> str:
    """Tabulate the true errors of random scenes beside those that ``auto`` wants and tells, by method."""
    rows = read_rows("auto_error")
    lines = []
    for method in (*sorted({row["method"] for row in rows}), "all"):
        own = [row for row in rows if method in (row["method"], "all")]
        told, true, wanted = ([float(row[key]) for row in own] for key in ("told", "true", "wanted"))
        pairs = list(zip(told, true, strict=True))
        above = [sum(b > a for a, b in zip(wanted, true, strict=True))]
        above += [sum(b > factor * a for a, b in pairs) for factor in (1, 3)]
        middle = median(a / b for a, b in pairs if b > 0)
        lines.append([method, str(len(own)), *map(str, above), format_ratio(middle)])
    head = ("method", "scenes", "true above wanted", "true above told", "above 3 × told", "told / true, median")
    return markdown(head, lines)


def clamps() -> str:
    """Tabulate the errors of frequencies behind averaged and rigid faces of fixed joints, in percent."""
    lines = []
    for row in read_rows("clamps"):
        errors = [
            "; ".join(f"{100 * float(row[f'{attachment} {k}']):.2g}" for k in (1, 2, 3))
            for attachment in ("averaged", "rigid")
        ]
        lines.append([row["body"], f"{float(row['extent']):.2g}", *errors])
    return markdown(("clamped at one face", "extent over reach", "averaged [%]", "rigid [%]"), lines)


def truth() -> str:
    """Tabulate what random scenes state, truly have and refuse, by their seeds and kinds.

    Rows without ratios are of a time when these weren't kept.
    """
    rows = read_rows("truth")
    lines = []
    for seeds, own in (
        ("0 to 299", [row for row in rows if int(row["seed"]) < FIRST_NEW]),
        ("from 500", [row for row in rows if int(row["seed"]) >= FIRST_NEW]),
    ):
        kinds = sorted({row["kind"] for row in own})
        lines += [
            [seeds, kind, *_counts([row for row in own if kind in (row["kind"], "all")])] for kind in (*kinds, "all")
        ]
    head = ("seeds", "kind", "scenes", "compared", "refused", "tracebacks", "no reference", "over 60 s")
    judged = ("true below stated", "wrong", "not judged", "below, of judged or not", "over 20 times")
    return markdown((*head, *judged, "stated / true, median, ninth tenth"), lines)


def _counts(own: list[Row]) -> list[str]:
    """Return the entries of a line of random scenes: outcomes, and what became of quantities."""
    outcomes = [
        str(sum(row["outcome"] == outcome for row in own))
        for outcome in ("compared", "refused", "traceback", "no reference")
    ]
    long = str(sum(float(row["seconds"]) > LONG for row in own))
    quantities, covered, wrong, bounded, overstated = (
        sum(int(row[key]) for row in own) for key in ("quantities", "covered", "wrong", "bounded", "overstated")
    )
    ratios = sorted(float(text) for row in own for text in row["ratios"].split())
    share = f"{100 * covered / quantities:.1f} % of {quantities}" if quantities else "–"
    of_all = f"{100 * covered / (quantities + bounded):.1f} %" if quantities + bounded else "–"
    spread = f"{median(ratios):.2g}, {ratios[int(0.9 * len(ratios))]:.2g}" if ratios else "–"
    return [
        str(len(own)), *outcomes, long, share, str(wrong), str(bounded), of_all,
        str(overstated) if ratios else "–", spread
    ]  # fmt: skip


def truth_pairs() -> str:
    """Count the pairs of features that the mixed scenes of the table have."""
    cases = [
        SimpleNamespace(features=tuple(row["features"].split(", "))) for row in read_rows("truth") if row["features"]
    ]
    seen, pairs, _ = pairwise_coverage(cases)  # type: ignore[arg-type]
    return f"Of {pairs} pairs of features the {len(cases)} mixed scenes of this table have {seen}.\n"
