"""A case of functional mock-up units: a scene leaves as an FMU, and FMPy runs it beside the mechanism's equations."""

from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from fmd.core.arrays import Array
from fmd.core.cache import Cache
from fmd.output.fmu.write import list_platforms, write_own_fmu
from fmd.verification.case import CaseSkipped, Figure, VerificationCase, open_scene

# Of the ready scene: rod about its end, slider, its place on the rod, spring, torque.
_ROD, _SLIDER, _PLACE, _SPRING, _TORQUE = 2.0 * 2.0**2 / 3.0, 5.0, 1.0, 1000.0, 1.7453292519943295
_START, _END = 0.15, 10.0
_NAMES = ("hinge.position", "slide.position")


def _rod_and_slider(_time: float, state: Array) -> Array:
    """Rates of angle, displacement and their rates, by Lagrange's equations."""
    _, x, spin, speed = state
    arm = _PLACE + x
    turn = (_TORQUE - 2.0 * _SLIDER * arm * speed * spin) / (_ROD + _SLIDER * arm**2)
    return np.array([spin, speed, turn, arm * spin**2 - _SPRING / _SLIDER * x])


def _by_fmpy(cache: Cache | None) -> list[Figure]:
    if find_spec("fmpy") is None:
        raise CaseSkipped("FMPy, which runs FMUs, isn't installed; pip install fmpy")
    import fmpy
    from scipy.integrate import solve_ivp

    start = np.array([0.0, _START, 0.0, 0.0])
    expected = solve_ivp(_rod_and_slider, (0.0, _END), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:2, -1]
    figures = []
    with TemporaryDirectory() as folder:
        files = write_own_fmu(open_scene("rod-slider", cache), Path(folder) / "rod-slider.fmu")
        if not list_platforms(files[0]):
            raise CaseSkipped("no C compiler is installed; pip install ziglang")
        for version, file in zip(("2.0", "3.0"), files, strict=True):
            for way, kind in {"model exchange": "ModelExchange", "co-simulation": "CoSimulation"}.items():
                rows = fmpy.simulate_fmu(
                    str(file),
                    fmi_type=kind,
                    stop_time=_END,
                    output_interval=0.05,
                    output=_NAMES,
                    relative_tolerance=1e-12,
                )
                for name, unit, value in zip(_NAMES, ("rad", "m"), expected, strict=True):
                    quantity = f"{name} at {_END:g} s, FMI {version}, {way} [{unit}]"
                    figures.append(Figure(quantity, float(rows[name][-1]), float(value), 1e-7))
    return figures


_SOURCE = "Lagrange's equations of rod and slider, integrated by SciPy"
CASES = (VerificationCase("fmu", "rod and slider as FMU, run by FMPy", _SOURCE, _by_fmpy),)
