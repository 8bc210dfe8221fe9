"""C code of loads and motions beside NumPy's evaluation of the same signals."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

from fmd.core.formula import parse_formula
from fmd.dynamics.compiler.c_source import write_c
from fmd.dynamics.compiler.signal_code import trace_signals
from fmd.dynamics.signals.signal import constant, formula, half_sine, linear_table, smooth_table, total

COMPILER = shutil.which("cc") or shutil.which("gcc")
TEXTS = (
    "1.5*sin(2*pi*3*t) if t < 0.4 else cos(t) - 2",
    "exp(-t)*tan(t/3) + tanh(3*t - 1)",
    "log(1 + t) / sqrt(2 + t)",
    "abs(t - 0.5) + min(t, 0.3) - max(2*t, 0.7)",
    "(t - 0.5)**3 + (1 + t)**(t - 2)",
    "-t**2 if t <= 0.6 else 2**t",
    "sqrt(t - 0.5) if t > 0.6 else 1",  # the branch that isn't taken is not a number
)
SAMPLES = np.array([0.1, 0.3, 0.45, 0.9]), np.array([1.0, -2.0, 0.5, 0.25])


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
def test_signals_have_the_same_values_rates_and_accelerations_in_c(tmp_path):
    signals = [formula(parse_formula(text), 2.5) for text in TEXTS]
    signals += [constant(3.0), linear_table(*SAMPLES), smooth_table(*SAMPLES)]
    signals.append(total([half_sine(0.2, 0.3, 4.0), constant(-1.0), signals[0]]))
    (tmp_path / "own.c").write_text(write_c({"own": trace_signals(signals)}))
    subprocess.run([COMPILER, "-shared", "-fPIC", "-o", "own.so", "own.c", "-lm"], cwd=tmp_path, check=True)
    function = ctypes.CDLL(str(tmp_path / "own.so")).own
    times, found = np.linspace(0.0, 1.0, 41) + 1e-4, []
    for t in times:
        time, inputs = np.array([t]), np.zeros((len(signals), 3))
        function(*(ctypes.byref(ctypes.c_void_p(array.ctypes.data)) for array in (time, inputs)))
        found.append(inputs)
    expected = np.stack([signal.values(times) for signal in signals], axis=1)
    assert np.stack(found) == pytest.approx(expected, rel=1e-12, abs=1e-12)
