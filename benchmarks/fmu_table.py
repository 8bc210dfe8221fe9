"""The table of FMUs from fmu.csv."""

from __future__ import annotations

from table_format import format_seconds, markdown, read_rows


def fmu() -> str:
    """Return errors by way and tolerance, sizes and run time of the scenes' FMUs."""
    header = (
        "scene, modes",
        "co-simulation at 1e-6",
        "1e-9",
        "1e-12",
        "model exchange",
        "FMI 2.0, 3.0 [kB]",
        "run time (ours)",
        "ratio",
    )
    rows = []
    for row in read_rows("fmu"):
        errors = [
            f"{max(float(row[f'{way}_fmi2']), float(row[f'{way}_fmi3'])):.1e}"
            for way in ("cs_1e-06", "cs_1e-09", "cs_1e-12", "me")
        ]
        times = f"{format_seconds(float(row['fmu_s']))} ({format_seconds(float(row['fmd_s']))})"
        sizes = f"{row['kilobytes_fmi2']}, {row['kilobytes_fmi3']}"
        rows.append((f"{row['scene']}, {row['modes']}", *errors, sizes, times, row["ratio"]))
    return markdown(header, rows)
