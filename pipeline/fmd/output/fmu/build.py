"""Binaries of an FMU: for all systems by the cross-compiler of the ziglang package, or for this one by its own."""

import importlib.util
import os
import platform
import shutil
import struct
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from fmd.core.errors import InputError
from fmd.core.limits.patience import COMPILING_SECONDS
from fmd.core.paths import cache_folder, is_private
from fmd.core.processes import ChildError, run_child
from fmd.integrators.side_by_side import threads_at_once

_OPTIONS = (
    *("-std=c99", "-g0", "-fPIC", "-fvisibility=hidden", "-Wall"),
    # Sums may be reordered for vector registers; infinities and what is not a number keep their meaning.
    *("-fno-math-errno", "-fno-trapping-math", "-fassociative-math", "-fno-signed-zeros"),
)
_FAST = ("model.c", "motion.c", "runge_kutta.c", "signals.c")  # what steps call; the rest is compiled to be small
_WINDOWS = "windows.c"  # what Zig's linker has in place of MinGW's library
_CRT = [f"-lapi-ms-win-crt-{part}-l1-1-0" for part in ("math", "heap", "string", "private")]  # Windows' C library
_FAT_MAGIC, _FAT_ALIGNMENT = 0xCAFEBABE, 14
_MACH_CPUS = {"x86_64-darwin": (0x01000007, 3), "aarch64-darwin": (0x0100000C, 0)}


class Target(NamedTuple):
    """A system that binaries are for: its name in FMI 3.0, the suffix of a library, and what Zig calls it."""

    name: str
    suffix: str
    triple: str


TARGETS = (
    Target("x86_64-linux", ".so", "x86_64-linux-gnu.2.17"),
    Target("aarch64-linux", ".so", "aarch64-linux-gnu.2.17"),
    Target("x86_64-windows", ".dll", "x86_64-windows-gnu"),
    Target("x86_64-darwin", ".dylib", "x86_64-macos.11.0"),
    Target("aarch64-darwin", ".dylib", "aarch64-macos.11.0"),
)
"""Systems for which Zig compiles."""

FMI2_FOLDERS = {"x86_64-linux": "linux64", "x86_64-windows": "win64", "x86_64-darwin": "darwin64"}
"""Folders of FMI 2.0; its ``darwin64`` has both kinds of processor in one file."""


def has_zig() -> bool:
    """Return whether the ziglang package is installed."""
    return importlib.util.find_spec("ziglang") is not None


def build_binaries(sources: Mapping[str, str], identifier: str) -> dict[str, bytes]:
    """Compile C sources to shared libraries by the names of their systems, for all by Zig, or without it for this one.

    Without any compiler there are none.

    Raises
    ------
    InputError
        The compiler fails; the message has the line that says why.
    """
    if has_zig():
        return _compile_for(sources, identifier, {target: _zig(target) for target in TARGETS})
    return build_own_binary(sources, identifier)


def build_own_binary(sources: Mapping[str, str], identifier: str) -> dict[str, bytes]:
    """Compile C sources for this system alone, by ``$CC``, cc, gcc or Zig; as `build_binaries`."""
    own = own_target()
    compiler = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc")
    if own is None or (compiler is None and not has_zig()):
        return {}
    return _compile_for(sources, identifier, {own: [compiler] if compiler else _zig(own)})


def _compile_for(
    sources: Mapping[str, str], identifier: str, compilers: Mapping[Target, Sequence[str]]
) -> dict[str, bytes]:
    with TemporaryDirectory(prefix="fmd-fmu-") as name, ThreadPoolExecutor(threads_at_once()) as pool:
        folder = Path(name)
        for source, text in sources.items():
            (folder / source).write_text(text, encoding="utf-8")
        largest_first = sorted(
            (source for source in sources if source.endswith(".c")), key=lambda own: -len(sources[own])
        )
        jobs = [(target, source) for target in compilers for source in largest_first]
        for target in compilers:
            if _is_bare(compilers[target], target):
                (folder / _WINDOWS).write_text((files("fmd.output.fmu") / "sources" / _WINDOWS).read_text("utf-8"))
                jobs.append((target, _WINDOWS))
        list(pool.map(lambda job: _compile(compilers[job[0]], folder, *job), jobs))
        libraries = pool.map(lambda target: _link(compilers[target], folder, identifier, target), compilers)
        return {target.name: library for target, library in zip(compilers, libraries, strict=True)}


def own_target() -> Target | None:
    """Return the system that this is, if there are binaries for it."""
    processor = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    system = platform.system().lower()
    return next((target for target in TARGETS if target.name == f"{processor}-{system}"), None)


def _zig(target: Target) -> list[str]:
    return [sys.executable, "-P", "-m", "ziglang", "cc", "-target", target.triple]


def _is_bare(compiler: Sequence[str], target: Target) -> bool:
    """Return whether a library is linked without MinGW's, whose 400 sources Zig would compile first, for a minute."""
    return compiler[0] == sys.executable and target.suffix == ".dll"


def _compile(compiler: Sequence[str], folder: Path, target: Target, source: str) -> None:
    """Compile a source of a folder, by a name relative to it: no path of this machine comes into the library."""
    level, mapped = "-O3" if source in _FAST else "-Os", f"-ffile-prefix-map={folder}=."
    plain = ["-fno-builtin"] if source == _WINDOWS else []
    _run([*compiler, *_OPTIONS, level, *plain, mapped, "-c", source, "-o", _object(target, source)], folder, target)


def _link(compiler: Sequence[str], folder: Path, identifier: str, target: Target) -> bytes:
    """Return the library of a target's compiled sources, in the order of their names.

    ``-Os`` tells Zig to link no library that looks for undefined behaviour, which it would compile first.
    """
    library, place = f"{identifier}{target.suffix}", folder / target.name  # of its own: two systems may have one name
    place.mkdir()
    objects = [f"../{compiled.name}" for compiled in sorted(folder.glob(_object(target, "*.c")))]
    strip = [] if platform.system() == "Darwin" and compiler[0] != sys.executable else ["-s"]
    maths = [] if target.suffix == ".dll" else ["-lm"]
    maths = ["-nostdlib", *_CRT] if _is_bare(compiler, target) else maths
    _run([*compiler, "-shared", "-Os", *strip, "-o", library, *objects, *maths], place, target)
    return (place / library).read_bytes()


def _object(target: Target, source: str) -> str:
    return f"{target.name}-{source.removesuffix('.c')}.o"


def _run(command: Sequence[str], folder: Path, target: Target) -> None:
    cache = cache_folder() / "zig"
    is_private(cache, make=True)
    environment = {"ZIG_GLOBAL_CACHE_DIR": str(cache), "ZIG_LOCAL_CACHE_DIR": str(cache)}
    try:
        run_child("exec", *command, seconds=COMPILING_SECONDS, folder=folder, environment=environment)
    except (OSError, ChildError) as error:
        said = getattr(error, "output", "").splitlines()
        fault = next((line for line in said if "error" in line), str(error))
        raise InputError("export", "fmu", target.name, f"the C compiler {command[0]} fails: {fault}") from error


def join_mach_binaries(binaries: Mapping[str, bytes]) -> bytes:
    """Join macOS libraries for several processors in one file, by the names of their systems.

    The file begins with a table, in big-endian order, of each library's processor, place, length and alignment.
    """
    chosen = [(cpu, binaries[name]) for name, cpu in _MACH_CPUS.items() if name in binaries]
    block = 1 << _FAT_ALIGNMENT
    table, body, place = struct.pack(">II", _FAT_MAGIC, len(chosen)), b"", block
    for (cpu, kind), data in chosen:
        table += struct.pack(">IIIII", cpu, kind, place, len(data), _FAT_ALIGNMENT)
        padded = data + bytes(-len(data) % block)
        body, place = body + padded, place + len(padded)
    return table.ljust(block, b"\0") + body
