"""The tutorial does what it says: its files are written and its commands run as they stand there."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

TUTORIAL = Path(__file__).parents[2] / "docs" / "your-part.md"
BLOCK = re.compile(r"^```(\w+)(?: (\S+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks() -> list[tuple[str, str, str]]:
    return [tuple(found) for found in BLOCK.findall(TUTORIAL.read_text(encoding="utf-8"))]


@pytest.fixture(scope="module")
def done(tmp_path_factory) -> tuple[Path, list[str]]:
    """The folder after all of its blocks, and what each command printed."""
    folder, printed = tmp_path_factory.mktemp("tutorial"), []
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for language, name, text in blocks():
        if name:
            (folder / name).write_text(text, encoding="utf-8")
        else:
            assert language == "bash"
            for line in text.splitlines():
                command = shlex.split(line, comments=True)
                if command[0] == "python":
                    command[0] = sys.executable
                result = subprocess.run(
                    command,
                    cwd=folder,
                    env=os.environ | {"PATH": path},
                    capture_output=True,
                    text=True,
                    timeout=600,
                    check=False,
                )
                assert result.returncode == 0, result.stderr
                printed.append(result.stdout)
    return folder, printed


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
