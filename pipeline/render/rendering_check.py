"""A check that this machine can draw, in another process: VTK without OpenGL dies of a signal."""

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
    """Draw a sphere off-screen in another process and return the failure, or ``None``."""
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
    """Return a sentence with the reason and the mend if this machine can't draw, or ``None``."""
    failure = rendering_failure()
    return None if failure is None else f"{failure}; {MEND}"
