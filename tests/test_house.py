"""The project's own papers agree with its code."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from fmd import __version__
from fmd.cli.doctor import DEBIAN_PACKAGES

ROOT = Path(__file__).parent.parent


def test_the_gate_installs_what_doctor_asks_for():
    gate = (ROOT / ".ci" / "run").read_text()
    listed = re.search(r"packages=\(([^)]*)\)", gate)
    assert listed is not None
    assert sorted(listed[1].split()) == sorted(DEBIAN_PACKAGES)


def test_the_version_is_the_same_everywhere():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["version"] == __version__
    assert f"## {__version__}" in (ROOT / "CHANGELOG.md").read_text()


def test_every_dependency_is_pinned_in_the_constraints():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    pinned = {line.partition("==")[0].lower() for line in (ROOT / "constraints.txt").read_text().splitlines()}
    extras = [name for group in project["optional-dependencies"].values() for name in group]
    for requirement in project["dependencies"] + extras:
        name = re.match(r"[A-Za-z0-9_.-]+", requirement)
        assert name is not None
        assert name[0].lower() in pinned


def test_the_constraints_hold_versions_and_no_addresses():
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        assert re.fullmatch(r"[A-Za-z0-9_.-]+==[A-Za-z0-9.]+", line)
