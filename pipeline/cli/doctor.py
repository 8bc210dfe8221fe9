"""``fmd doctor``: a check of the machine."""

from __future__ import annotations

from pipeline.cli.doctor_checks import describe_machine, find_problems
from pipeline.cli.options import Json, print_json
from pipeline.core.paths import cache_folder


def doctor(*, json: Json = False) -> None:
    """Check what this machine lacks, and print the command that mends it."""
    problems = find_problems(cache_folder())
    if json:
        print_json({"ok": not problems, "problems": [{"what": p.what, "mend": p.mend} for p in problems]})
    else:
        for name, value in describe_machine().items():
            print(f"{name}: {value}")
        for problem in problems:
            print(f"lacking: {problem.what}\n  mend: {problem.mend}")
        print(f"{len(problems)} to mend" if problems else "this machine can do everything")
    if problems:
        raise SystemExit(3)
