"""``fmd doctor``: a check of the machine."""

from __future__ import annotations

from fmd.cli.doctor_checks import describe_machine, find_problems
from fmd.cli.options import Json, print_json
from fmd.cli.start_times import measure_start
from fmd.core.paths import cache_folder


def doctor(*, json: Json = False) -> None:
    """Check what this machine lacks, print the command that mends it, and say what a command's start is made of."""
    problems, start = find_problems(cache_folder()), measure_start()
    if json:
        found = [{"what": p.what, "mend": p.mend} for p in problems]
        print_json({"ok": not problems, "problems": found, "start_seconds": start})
    else:
        for name, value in describe_machine().items():
            print(f"{name}: {value}")
        for name, seconds in start.items():
            print(f"start, {name}: {seconds:.2f} s")
        if not start["kernels from the disk"]:
            print("start, kernels: none kept yet, so the first run of a scene compiles")
        for problem in problems:
            print(f"lacking: {problem.what}\n  mend: {problem.mend}")
        print(f"{len(problems)} to mend" if problems else "this machine can do everything")
    if problems:
        raise SystemExit(3)
