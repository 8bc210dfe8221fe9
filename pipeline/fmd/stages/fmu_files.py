"""FMUs of others that a scene names, checked before anything is computed."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from fmd.core.errors import InputError
from fmd.core.files import digest_file
from fmd.dynamics.fmu_law import FmuLaw
from fmd.scene.controllers import FmuController
from fmd.scene.reading import suggest_name


def fmu_law(given: FmuController, scene_file: str, name: str) -> FmuLaw:
    """Return the law of a controller that an FMU computes.

    Raises
    ------
    InputError
        FMPy or the file is missing, it is no FMU for co-simulation on this system, or lacks a variable.
    """
    key, path = f"controller.{name}", Path(scene_file).parent / given.file
    if find_spec("fmpy") is None:
        raise InputError(scene_file, f"{key}.type", "fmu", "needs FMPy: install this package's extra 'fmu'")
    try:
        digest = digest_file(path)
    except ValueError as error:
        raise InputError(scene_file, f"{key}.file", given.file, str(error)) from None
    wanted = [("input", each, "input") for each in given.input]
    wanted += [("parameters", each, "parameter") for each in given.parameters]
    wanted.append(("output", given.output, ""))
    kinds = _read_variables(path, scene_file, key, given.file)
    for option, variable, kind in wanted:
        names = [each for each, own in kinds.items() if kind in ("", own)]
        if variable not in names:
            mend = suggest_name(variable, names, f"its variables of kind {kind or 'real'}")
            raise InputError(scene_file, f"{key}.{option}", variable, mend)
    values = (tuple(given.input), given.output, tuple(given.parameters.items()), given.sample_time)
    return FmuLaw(name, str(path), digest, *values, given.coupling, given.order)


def _read_variables(path: Path, scene_file: str, key: str, given: str) -> dict[str, str]:
    """Return the kind of each real variable of an FMU that runs here."""
    import fmpy

    try:
        description = fmpy.read_model_description(str(path), validate=False)
        platforms = fmpy.supported_platforms(str(path))
    except Exception as error:  # of zip files, of XML and FMPy's own
        raise InputError(scene_file, f"{key}.file", given, f"can't be read as an FMU: {error}") from error
    fault = ""
    if not description.fmiVersion.startswith(("2.", "3.")):
        fault = f"is of FMI {description.fmiVersion}; 2.0 and 3.0 are run"
    elif description.coSimulation is None:
        fault = "is for model exchange alone; export it for co-simulation, with its solver in it"
    elif fmpy.platform not in platforms:
        fault = f"holds no program for {fmpy.platform}, but for {', '.join(platforms) or 'none'}"
    if fault:
        raise InputError(scene_file, f"{key}.file", given, fault)
    real = ("Real", "Float64")
    return {each.name: each.causality for each in description.modelVariables if each.type in real}
