"""Whether this machine can draw, found out in a process of its own: VTK without OpenGL dies by a signal."""

from __future__ import annotations

import signal
import subprocess
import sys

# libegl1 brings Mesa's EGL and libgl1 its software driver.
PACKAGES = ("libgl1", "libegl1")
MEND = f"install OpenGL's software driver, on Debian and Ubuntu by: apt-get install {' '.join(PACKAGES)}"
TIMEOUT = 120.0  # seconds; the first import after an installation compiles PyVista
DRAWING = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=[32, 32])
plotter.add_mesh(pyvista.Sphere(), color="black")
if not plotter.screenshot(return_img=True).std() > 0:
    raise SystemExit("the picture is blank")
"""


def rendering_failure(timeout: float = TIMEOUT) -> str | None:
    """Draw a sphere off-screen in a process of its own and return what failed, if anything did."""
    try:
        result = subprocess.run(
            [sys.executable, "-c", DRAWING], capture_output=True, text=True, timeout=timeout, check=False
        )
    except subprocess.TimeoutExpired:
        return f"drawing off-screen took more than {timeout:g} s"
    if result.returncode == 0:
        return None
    if result.returncode < 0:
        return f"drawing off-screen died of {signal.Signals(-result.returncode).name}"
    last = (result.stderr.strip().splitlines() or [f"exit status {result.returncode}"])[-1]
    return f"drawing off-screen failed ({last})"


def rendering_problem() -> str | None:
    """Say in one sentence why pictures can't be drawn here and what would mend it; ``None`` if they can."""
    failure = rendering_failure()
    return None if failure is None else f"{failure}; {MEND}"
