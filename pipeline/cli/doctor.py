"""``fmd doctor``."""

from __future__ import annotations

from pipeline.cli.options import Json, print_json


def doctor(*, json: Json = False) -> None:
    """Tell what this machine lacks, and the command that mends it."""
    from pipeline.cli.doctor_checks import information, problems
    from pipeline.core.paths import cache_folder

    found = problems(cache_folder())
    if json:
        print_json({"ok": not found, "problems": [{"what": p.what, "mend": p.mend} for p in found]})
    else:
        for name, value in information().items():
            print(f"{name}: {value}")
        for problem in found:
            print(f"lacking: {problem.what}\n  mend: {problem.mend}")
        print("this machine can do everything" if not found else f"{len(found)} to mend")
    if found:
        raise SystemExit(3)
