"""Write a scene's mechanism as two FMUs, of FMI 2.0 and 3.0: sources, binaries and descriptions."""

import hashlib
import re
import zipfile
from collections.abc import Callable, Mapping
from importlib.resources import files
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.files import require_not_spared, whole_file
from fmd.core.limits.stepping import CO_SIMULATED
from fmd.core.version import __version__
from fmd.dynamics.compiler.external import ExternalMechanism
from fmd.dynamics.compiler.external_quantities import ElementStress
from fmd.dynamics.mechanism import Mechanism
from fmd.output.fmu.build import FMI2_FOLDERS, build_binaries, build_own_binary, join_mach_binaries
from fmd.output.fmu.description import Heading, describe_build, describe_fmi2, describe_fmi3
from fmd.output.fmu.equations import write_coefficients, write_equations
from fmd.output.fmu.variables import Interface, make_interface
from fmd.scene.loads import MarkerLoad
from fmd.stages.pipeline import Pipeline
from fmd.stages.run_checks import require_no_contact

_FIXED = (
    "calls.h",
    "fmi2.c",
    "fmi3.c",
    "instance.c",
    "instance.h",
    "model.c",
    "model.h",
    "runge_kutta.c",
    "wide.c",
    "wide.h",
)


def write_fmu(run: Pipeline, _body: str | None, path: Path) -> list[Path]:
    """Write a scene's mechanism as an FMU of FMI 2.0, and as one of FMI 3.0 beside it.

    Raises
    ------
    InputError
        The mechanism has loops, or a compiler fails.
    """
    return _write_both(run, path, build_binaries)


def write_own_fmu(run: Pipeline, path: Path) -> list[Path]:
    """Write both FMUs with a binary for this system alone, which takes the least time; as `write_fmu`."""
    return _write_both(run, path, build_own_binary)


def _write_both(run: Pipeline, path: Path, build: Callable[[Mapping[str, str], str], dict[str, bytes]]) -> list[Path]:
    beside = path.with_name(f"{path.stem}-fmi3{path.suffix}")
    require_not_spared(beside)  # before a minute of compiling
    heading, interface, sources = make_model(run)
    binaries = build(sources, heading.identifier)
    _write_zip(path, _members_fmi2(heading, interface, sources, binaries))
    _write_zip(beside, _members_fmi3(heading, interface, sources, binaries))
    return [path, beside]


def list_platforms(path: Path) -> list[str]:
    """Return the names of the systems that an FMU has binaries for."""
    with zipfile.ZipFile(path) as archive:
        places = [name.split("/") for name in archive.namelist()]
    return sorted({place[1] for place in places if place[0] == "binaries"})


def make_model(run: Pipeline) -> tuple[Heading, Interface, dict[str, str]]:
    """Return the heading, the variables and the C sources of a scene's mechanism.

    Raises
    ------
    InputError
        The mechanism has loops, or loads by its own motion.
    """
    scene = run.divided_scene
    require_no_contact(scene, "an FMU")
    if run.mechanism.efforts:
        mend = "export the scene without it, and let the other program give the torque"
        raise InputError(scene.file, "drive", None, f"an FMU can't hold a load by a formula of the motion; {mend}")
    if loops := [*scene.closing, *scene.coupler]:
        mend = "closes a loop, whose forces an FMU can't compute yet; export a tree of joints"
        raise InputError(scene.file, "joint" if scene.closing else "coupler", ", ".join(loops), mend)
    mechanism = run.mechanism
    external = ExternalMechanism(mechanism, run.with_whole_inertia(mechanism), _element_stresses(run))
    point_loads = [name for name, drive in scene.drive.items() if isinstance(drive, MarkerLoad)]
    q0, v0 = run.start
    nominal = _nominal_sizes(mechanism, q0, v0)
    interface = make_interface(external, point_loads, q0, v0, nominal, CO_SIMULATED)
    sources = {name: (files("fmd.output.fmu") / "sources" / name).read_text(encoding="utf-8") for name in _FIXED}
    sources["coefficients.h"] = write_coefficients()
    bare = write_equations(external, interface, run.system, (q0, v0), nominal, "")
    token = _token({**sources, **bare}, interface)
    sources |= write_equations(external, interface, run.system, (q0, v0), nominal, token)
    identifier = re.sub(r"\W", "_", scene.name, flags=re.ASCII)
    identifier = identifier if identifier.isidentifier() else f"scene_{identifier}"
    compiled = tuple(sorted(name for name in sources if name.endswith(".c")))
    simulation = scene.simulation
    heading = Heading(
        scene.name,
        identifier,
        token,
        scene.title,
        __version__,
        float(simulation.duration),
        float(simulation.output_step),
        compiled,
    )
    return heading, interface, sources


def _element_stresses(run: Pipeline) -> tuple[ElementStress, ...]:
    found = []
    for body, part in run.parts.items():
        if not (part.has_mesh and part.elements):
            continue
        for name, modal in zip(part.elements, part.element_stress, strict=True):
            found.append(ElementStress(run.mechanism.number_of(body), name, np.asarray(modal, dtype=float)))
    return tuple(found)


def _nominal_sizes(mechanism: Mechanism, q0: Array, v0: Array) -> Array:
    """Return the size of each state that a solver may scale errors by; modes by what moves a body by a micrometre."""
    positions, rates = np.ones(mechanism.n_positions), np.ones(mechanism.n)
    for body, link in enumerate(mechanism.links):
        if not len(link.omega):
            continue
        size = 1e-6 * np.sqrt(link.integrals.mass)
        positions[mechanism.modal_positions_of(body)] = size
        rates[mechanism.modes_of(body)] = size * link.omega
    return np.concatenate([np.maximum(positions, 0.0), np.where(rates > 0.0, rates, 1.0)])


def _token(sources: Mapping[str, str], interface: Interface) -> str:
    digest = hashlib.blake2b(repr((sorted(sources.items()), interface)).encode(), digest_size=16).hexdigest()
    return f"{{{digest[:8]}-{digest[8:12]}-{digest[12:16]}-{digest[16:20]}-{digest[20:]}}}"


def _members_fmi2(
    heading: Heading, interface: Interface, sources: Mapping[str, str], binaries: Mapping[str, bytes]
) -> dict[str, bytes]:
    members = {"modelDescription.xml": describe_fmi2(heading, interface)}
    members |= {f"sources/{name}": text.encode() for name, text in sources.items()}
    macs = {name: data for name, data in binaries.items() if name.endswith("darwin")}
    for name, folder in FMI2_FOLDERS.items():
        if name.endswith("darwin") and macs:
            members[f"binaries/{folder}/{heading.identifier}.dylib"] = join_mach_binaries(macs)
        elif name in binaries:
            suffix = ".dll" if name.endswith("windows") else ".so"
            members[f"binaries/{folder}/{heading.identifier}{suffix}"] = binaries[name]
    return members


def _members_fmi3(
    heading: Heading, interface: Interface, sources: Mapping[str, str], binaries: Mapping[str, bytes]
) -> dict[str, bytes]:
    members = {"modelDescription.xml": describe_fmi3(heading, interface)}
    members["sources/buildDescription.xml"] = describe_build(heading)
    members |= {f"sources/{name}": text.encode() for name, text in sources.items()}
    suffixes = {"windows": ".dll", "darwin": ".dylib", "linux": ".so"}
    for name, data in binaries.items():
        members[f"binaries/{name}/{heading.identifier}{suffixes[name.partition('-')[2]]}"] = data
    return members


def _write_zip(path: Path, members: Mapping[str, bytes]) -> None:
    with whole_file(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))  # the same input makes the same file
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, data)
