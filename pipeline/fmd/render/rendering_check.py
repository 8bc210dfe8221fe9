"""A check that this machine can draw, in another process: VTK without OpenGL dies of a signal."""

from fmd.core.processes import ChildError, run_child

# libegl1 brings Mesa's EGL and libgl1 its software driver.
PACKAGES = ("libgl1", "libegl1")
MEND = f"install OpenGL's software driver, on Debian and Ubuntu by: apt-get install {' '.join(PACKAGES)}"
TIMEOUT = 120.0  # seconds; the first import after an installation compiles VTK's modules
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


def rendering_failure(timeout: float = TIMEOUT) -> str | None:
    """Draw a sphere off-screen in another process and return the failure, or ``None``."""
    try:
        run_child("fmd.render.rendering_check:draw_sphere", seconds=timeout)
    except ChildError as error:
        return f"drawing off-screen took more than {timeout:g} s" if error.late else describe_failure(str(error))
    return None


def describe_failure(reason: str) -> str:
    """Say that drawing has failed, from what a process's end is described by."""
    died = reason.removeprefix("it died of ")
    return f"drawing off-screen failed ({reason})" if died == reason else f"drawing off-screen died of {died}"
