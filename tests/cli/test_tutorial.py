"""The tutorial does what it says: its files are written and its commands run as they stand there."""

import io
import json
import re
import shlex
import subprocess
import sys
from contextlib import chdir, redirect_stdout
from pathlib import Path

import pytest

from fmd.cli.app import main

TUTORIAL = Path(__file__).parents[2] / "docs" / "your-part.md"
BLOCK = re.compile(r"^```(\w+)(?: (\S+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks() -> list[tuple[str, str, str]]:
    return [tuple(found) for found in BLOCK.findall(TUTORIAL.read_text(encoding="utf-8"))]


@pytest.fixture(scope="module")
def done(tmp_path_factory) -> tuple[Path, list[str]]:
    """The folder after all of its blocks, and what each command printed."""
    folder, printed = tmp_path_factory.mktemp("tutorial"), []
    for language, name, text in blocks():
        if name:
            (folder / name).write_text(text, encoding="utf-8")
        else:
            assert language == "bash"
            for line in text.splitlines():
                printed.append(run(shlex.split(line, comments=True), folder))
    return folder, printed


def run(command: list[str], folder: Path) -> str:
    """Run Python in a process of its own, `fmd` in this one; return what is printed."""
    program, *arguments = command
    if program == "python":
        return subprocess.run(
            [sys.executable, *arguments], cwd=folder, capture_output=True, text=True, timeout=600, check=True
        ).stdout
    assert program == "fmd"
    out = io.StringIO()
    with chdir(folder), redirect_stdout(out), pytest.raises(SystemExit) as stop:
        main(arguments)
    assert not stop.value.code
    return out.getvalue()


@pytest.mark.slow
def test_the_tutorials_part_has_its_volume_modes_and_picture(done: tuple[Path, list[str]]) -> None:
    folder, printed = done
    volume = (60 * 40 * 8 + 8 * 40 * 32) * 1e-9 - 3.141592653589793 * 0.009**2 * 0.008
    assert float(re.search(r"volume m3\s+(\S+)", printed[1])[1]) == pytest.approx(volume, rel=1e-4)
    assert "6 rigid-body modes" in printed[2] or "rigid-body modes" in printed[2]
    summary = json.loads((folder / "out" / "bracket" / "summary.json").read_text())
    assert summary["bodies"]["bracket"]["mass_kg"] == pytest.approx(2700 * volume, rel=1e-4)
    assert (folder / "out" / "bracket" / "stress.png").stat().st_size > 10_000
    # 3000 rpm after the pulse, from then on but for what the modes swing
    assert summary["final"]["time_s"] == pytest.approx(3e-3)
