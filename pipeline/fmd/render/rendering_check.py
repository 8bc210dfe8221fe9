"""A check that this machine can draw, in another process: VTK without OpenGL dies of a signal."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

# libegl1 brings Mesa's EGL and libgl1 its software driver.
PACKAGES = ("libgl1", "libegl1")
MEND = f"install OpenGL's software driver, on Debian and Ubuntu by: apt-get install {' '.join(PACKAGES)}"
TIMEOUT = 120.0  # seconds; the first import after an installation compiles VTK's modules
_ROOT = Path(__file__).parents[2]
_SIZE = 32  # pixels


def draw_sphere() -> None:
    """Draw a sphere off-screen by the least that this takes of VTK.

    Raises
    ------
    RuntimeError
        The picture is blank; a machine without OpenGL kills the process instead.
    """
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401 - what VTK draws with
    from vtkmodules.vtkCommonCore import vtkLogger, vtkUnsignedCharArray
    from vtkmodules.vtkFiltersSources import vtkSphereSource
    from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper, vtkRenderer, vtkRenderWindow

    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)  # no warning of a missing X server: EGL replaces it
    sphere, mapper, actor = vtkSphereSource(), vtkPolyDataMapper(), vtkActor()
    renderer, window, pixels = vtkRenderer(), vtkRenderWindow(), vtkUnsignedCharArray()
    mapper.SetInputConnection(sphere.GetOutputPort())
    actor.SetMapper(mapper)
    renderer.AddActor(actor)
    window.SetOffScreenRendering(True)
    window.SetSize(_SIZE, _SIZE)
    window.AddRenderer(renderer)
    window.Render()
    window.GetPixelData(0, 0, _SIZE - 1, _SIZE - 1, 0, pixels, 0)
    colours = {pixels.GetValue(k) for k in range(pixels.GetNumberOfValues())}
    window.Finalize()
    if len(colours) < 2:
        raise RuntimeError("the picture is blank")


def start_python(statement: str, stderr: int, stdin: int | None = None) -> subprocess.Popen[str]:
    """Start another Python process that runs a statement with this package in its path."""
    program = f"import sys; sys.path.insert(0, sys.argv[1]); {statement}"
    command = [sys.executable, "-c", program, str(_ROOT)]
    return subprocess.Popen(command, stdin=stdin, stdout=subprocess.PIPE, stderr=stderr, text=True, encoding="utf-8")


def rendering_failure(timeout: float = TIMEOUT) -> str | None:
    """Draw a sphere off-screen in another process and return the failure, or ``None``."""
    statement = "from fmd.render.rendering_check import draw_sphere; draw_sphere()"
    process = start_python(statement, stderr=subprocess.PIPE)
    try:
        _, errors = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return f"drawing off-screen took more than {timeout:g} s"
    return describe_end(process.returncode, errors) if process.returncode else None


def describe_end(status: int, errors: str) -> str:
    """Say why a drawing process has ended, from its exit status and what it has printed."""
    if status < 0:
        return f"drawing off-screen died of {signal.Signals(-status).name}"
    last = (errors.strip().splitlines() or [f"exit status {status}"])[-1]
    return f"drawing off-screen failed ({last})"


def rendering_problem() -> str | None:
    """Return a sentence with the reason and the mend if this machine can't draw, or ``None``."""
    failure = rendering_failure()
    return None if failure is None else f"{failure}; {MEND}"
