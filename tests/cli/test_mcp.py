"""Tools of `fmd mcp` on twenty written tasks, against closed forms, and served by the official SDK if it is there."""

import asyncio
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fmd.cli.mcp import make_server
from fmd.cli.mcp_tools import TOOLS, SceneTools
from fmd.core.errors import InputError
from tests.sweep.test_results import SCENE

FALL = 2.5 * 9.81  # force of a rod's hinge when it hangs, over its mass
PEAK = 1.0 / (2 * 0.05 * 32.0 * math.sqrt(1 - 0.05**2))
SOFT = ["joint.slide.spring=8 N/m"]


@pytest.fixture(scope="module")
def tools(tmp_path_factory: pytest.TempPathFactory) -> SceneTools:
    folder = tmp_path_factory.mktemp("scenes")
    (folder / "both.toml").write_text(SCENE)
    (folder / "pyproject.toml").write_text('[project]\nname = "other"\n')
    return SceneTools(folder)


def result(name: str, figure: str = "value") -> Callable[[Any], float]:
    return lambda found: float(found["results"][name][name.partition(" =")[0]][figure])


TASKS: list[tuple[str, str, dict[str, Any], Callable[[Any], Any], Any]] = [
    ("Which scenes do I have?", "scenes", {}, lambda found: found["files"], ["both.toml"]),
    ("Is there a ready rotor?", "scenes", {}, lambda found: "rotor" in found["ready"], True),
    ("What bodies are in it?", "load", {}, lambda found: [*found["as_read"]["body"]], ["rod", "block"]),
    ("How stiff is the slide?", "load", {}, lambda found: found["as_read"]["joint"]["slide"]["spring"], 32.0),
    ("And with half of it?", "load", {"set": SOFT}, lambda f: f["as_read"]["joint"]["slide"]["spring"], 8.0),
    ("Show me the file.", "load", {}, lambda found: found["text"], SCENE),
    ("Can it run?", "check", {}, lambda found: found, {"sound": True, "faults": []}),
    ("Without units?", "check", {"set": ["body.rod.mass=1"]}, lambda found: "needs a unit" in found["faults"][0], True),
    ("On a hook?", "check", {"set": ["joint.hinge.child=rod.hook"]}, lambda found: "hook" in found["faults"][0], True),
    (
        "How hard is the hinge pulled?",
        "run",
        {"results": ["hinge.force.size"]},
        result("hinge.force.size", "largest"),
        FALL,
    ),
    (
        "And with twice the mass?",
        "run",
        {"results": ["hinge.force.size"], "set": ["body.rod.mass=2 kg"]},
        result("hinge.force.size", "largest"),
        2 * FALL,
    ),
    ("How deep does it come?", "run", {"results": ["deep = -rod.end.y"]}, result("deep = -rod.end.y", "largest"), 1.0),
    ("What does all of it weigh?", "run", {"results": ["mass"]}, result("mass"), 3.0),
    (
        "How does the block resonate?",
        "run",
        {"results": ["block.centre.x by block.centre.x"]},
        result("block.centre.x by block.centre.x"),
        PEAK,
    ),
    ("When does it end?", "run", {}, lambda found: found["final"]["time_s"], 0.8),
    ("Is something wrong with it?", "run", {}, lambda found: found["warnings"], []),
    ("Draw it.", "picture", {}, lambda found: found[:4], b"\x89PNG"),
    (
        "Draw the hinge's loads.",
        "picture",
        {"type": "history", "keys": {"quantities": ["joint_reaction"]}},
        lambda found: found[:4],
        b"\x89PNG",
    ),
    ("Keep the soft one.", "change", {"file": "soft.toml", "set": SOFT}, lambda found: "8 N/m" in found["text"], True),
    ("Run that one.", "load", {"scene": "soft.toml"}, lambda f: f["as_read"]["joint"]["slide"]["spring"], 8.0),
]


@pytest.mark.parametrize(("task", "tool", "given", "read", "answer"), TASKS, ids=[task[0] for task in TASKS])
def test_a_written_task_has_its_answer(
    tools: SceneTools, task: str, tool: str, given: dict[str, Any], read: Callable[[Any], Any], answer: Any
) -> None:
    scene = {} if tool == "scenes" else {"scene": "both.toml"}
    found = read(getattr(tools, tool)(**(scene | given)))
    assert found == (pytest.approx(answer, rel=1e-3) if isinstance(answer, float) else answer), task


@pytest.mark.parametrize(
    ("tool", "given", "text"),
    [
        ("load", {"scene": "../both.toml"}, "lies outside"),
        ("change", {"scene": "both.toml", "file": "/tmp/new.toml", "set": SOFT}, "lies outside"),
        ("change", {"scene": "both.toml", "file": "both.toml", "set": SOFT}, "must be a new file"),
        ("change", {"scene": "both.toml", "file": "bad.toml", "set": ["joint.slide.spring=8 kg"]}, "spring"),
        ("run", {"scene": "both.toml", "results": ["hinge.forse"]}, "did you mean 'hinge.force'?"),
        ("picture", {"scene": "both.toml", "type": "photo"}, "the pictures"),
        ("picture", {"scene": "both.toml", "keys": {"file": "a.csv"}}, "aren't among them"),
    ],
)
def test_what_a_tool_cannot_do_is_said_in_one_message(
    tools: SceneTools, tool: str, given: dict[str, Any], text: str
) -> None:
    with pytest.raises(InputError) as fault:
        getattr(tools, tool)(**given)
    assert text in str(fault.value)
    assert not (tools.folder / "bad.toml").exists()


def test_the_sdk_serves_the_tools_and_nothing_else(tools: SceneTools) -> None:
    mcp = pytest.importorskip("mcp", reason="the SDK isn't installed")

    async def talk() -> tuple[set[str], Any, Any, Any]:
        async with mcp.Client(make_server(tools.folder)) as client:
            listed = await client.list_tools()
            sound = await client.call_tool("check", {"scene": "both.toml"})
            picture = await client.call_tool("picture", {"scene": "both.toml"})
            fault = await client.call_tool("load", {"scene": "none.toml"})
            return {tool.name for tool in listed.tools}, sound, picture, fault

    names, sound, picture, fault = asyncio.run(talk())
    assert names == set(TOOLS)
    assert '"sound": true' in sound.content[0].text
    assert (picture.content[0].type, picture.content[0].mime_type) == ("image", "image/png")
    assert fault.is_error
    assert "no such file" in fault.content[0].text


STRAY = """
import os, subprocess, sys
from pathlib import Path
import fmd.cli.mcp as served

class Server:
    def run(self, transport):
        os.write(1, b"of a library")
        subprocess.run([sys.executable, "-c", "print('of a child')"], check=True)
        sys.stdout.buffer.write(b"{}\\n")
        sys.stdout.buffer.flush()

served.make_server = lambda folder: Server()
served.mcp(Path())
os.write(1, b"afterwards")
"""


def test_what_libraries_and_children_print_is_not_among_the_protocol() -> None:
    run = subprocess.run([sys.executable, "-c", STRAY], capture_output=True, check=True, text=True)
    assert run.stdout == "{}\nafterwards"
    assert run.stderr == "of a libraryof a child\n"


def test_without_the_sdk_the_command_names_the_extra(
    fmd, capsys, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mcp.server.mcpserver", None)
    assert fmd("mcp", tmp_path) == 2
    assert "needs the SDK: install this package's extra 'mcp'" in capsys.readouterr().err
