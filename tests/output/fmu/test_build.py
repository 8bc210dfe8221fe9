"""Compilers of FMUs: one that fails is told; libraries of two processors are one file on macOS."""

import re
import shutil
import struct
import threading

import numpy as np
import pytest

from fmd.core.errors import InputError
from fmd.output.fmu import build
from fmd.output.fmu.build import build_binaries, build_own_binary, join_mach_binaries, own_target

SOURCE = {"model.c": "int answer(void)\n{\n    return 42;\n}\n"}


@pytest.mark.skipif(own_target() is None, reason="this system has no FMU binaries")
@pytest.mark.skipif(not (shutil.which("cc") or shutil.which("gcc")), reason="no C compiler")
def test_what_the_compiler_says_is_told(monkeypatch):
    monkeypatch.setattr(build, "has_zig", lambda: False)
    with pytest.raises(InputError, match=r"the C compiler .* fails: .*error"):
        build_binaries({"model.c": "int answer(void) { return }"}, "x")
    monkeypatch.setenv("CC", "/missing/compiler")
    with pytest.raises(InputError, match="missing/compiler fails"):
        build_binaries(SOURCE, "x")


@pytest.mark.skipif(own_target() is None, reason="this system has no FMU binaries")
@pytest.mark.skipif(not (shutil.which("cc") or shutil.which("gcc")), reason="no C compiler")
def test_sources_compiled_side_by_side_make_the_library_of_those_compiled_in_turn(monkeypatch):
    calls = {f"part{k}.c": f"int part{k}(void)\n{{\n    return {k};\n}}\n" for k in range(3)}
    total = "".join(f"int part{k}(void);\n" for k in range(3)) + "int total(void)\n{\n    return "
    sources = calls | {"model.c": total + " + ".join(f"part{k}()" for k in range(3)) + ";\n}\n"}
    libraries, threads, run = [], set(), build._run
    monkeypatch.setattr(build, "_run", lambda *job: (threads.add(threading.get_ident()), run(*job))[1])
    for at_once in ("1", "4"):
        threads.clear()
        monkeypatch.setenv("OMP_NUM_THREADS", at_once)
        libraries.append(build_own_binary(sources, "x"))
    assert len(threads) > 2
    assert libraries[0] == libraries[1] != {}


@pytest.mark.skipif(not build.has_zig(), reason="ziglang isn't installed")
def test_a_library_for_windows_takes_windows_own_c_library_and_nothing_of_mingw():
    source = """
    #include <math.h>
    double answer(int n, double x)
    {
        volatile double frame[4096]; /* more than a page: its stack is touched page by page */
        frame[n] = sin(x) * cos(x) + pow(x, n);
        return isfinite(frame[n]) ? frame[n] : 0.0;
    }"""
    (windows,) = (target for target in build.TARGETS if target.suffix == ".dll")
    library = build._compile_for({"model.c": source}, "x", {windows: build._zig(windows)})[windows.name]
    imported = {name.lower() for name in re.findall(rb"[\w-]+\.dll", library, re.I)} - {b"x.dll"}
    assert imported == {b"api-ms-win-crt-math-l1-1-0.dll"}


def test_libraries_of_two_processors_are_joined_for_macos():
    rng = np.random.default_rng(1)
    parts = {"aarch64-darwin": rng.bytes(40_000), "x86_64-darwin": rng.bytes(17)}
    joined = join_mach_binaries(parts)
    magic, count = struct.unpack(">II", joined[:8])
    assert (magic, count) == (0xCAFEBABE, 2)
    entries = [struct.unpack(">IIIII", joined[8 + 20 * k : 28 + 20 * k]) for k in range(2)]
    for (cpu, _, place, size, power), name in zip(entries, ("x86_64-darwin", "aarch64-darwin"), strict=True):
        assert cpu == {"x86_64-darwin": 0x01000007, "aarch64-darwin": 0x0100000C}[name]
        assert place % (1 << power) == 0
        assert joined[place : place + size] == parts[name]
