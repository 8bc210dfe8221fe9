"""What a scene compiles: each kernel once, and none of a method that it doesn't use."""

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

LISTING = """
import json
from numba.core import event, types
from pipeline.cli.app import main
import pipeline.dynamics.jit.compiled

seen = []

class Names(event.Listener):
    def on_start(self, event):
        function = event.data["dispatcher"].py_func
        kinds = [types.unliteral(kind) for kind in event.data["args"]]
        seen.append((function.__module__, function.__qualname__, str(kinds)))

    def on_end(self, event):
        pass

with event.install_listener("numba:compile", Names()):
    try:
        main()
    except SystemExit as stop:
        assert not stop.code
print("\\n" + json.dumps(seen))
"""


@pytest.mark.slow
def test_a_scene_compiles_each_kernel_once_and_only_those_of_its_methods(tmp_path: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    arguments = ["run", "arm", "--no-pictures", "--no-budget"]
    command = [sys.executable, "-c", LISTING, *arguments, "--out", str(tmp_path / "out")]
    environment["FMD_CACHE"] = str(tmp_path / "cache")
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=500, env=environment)
    seen = [(module, name, kinds) for module, name, kinds in json.loads(done.stdout.splitlines()[-1])]
    ours = Counter((module, name) for module, name, _ in seen if module.startswith("pipeline."))
    # Only what is told an order, 3 or 4, as a constant is compiled for each: `step_factor` raises to its reciprocal.
    assert {name for name, count in ours.items() if count > 1} <= {("pipeline.integrators.adaptive", "step_factor")}
    methods = {module.rpartition(".")[2] for module, name in ours if name == "_march"}
    assert methods == {"central_difference", "generalized_alpha", "rosenbrock"}
