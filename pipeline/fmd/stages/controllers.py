"""From a scene's controllers to functions of a mechanism's state, and to laws that sample it."""

import math
from importlib.util import find_spec
from pathlib import Path

from fmd.core.errors import InputError, as_input_error
from fmd.core.files import digest_file
from fmd.dynamics.controllers import LinearLaw, SampledController
from fmd.dynamics.fmu_law import FmuLaw
from fmd.dynamics.links import Link, controller_state
from fmd.dynamics.state_functions import HeldValue, JointValue, Measured, StateFunction
from fmd.scene.controllers import ExternalValue, FmuController, LagController, PidController
from fmd.scene.reading import suggest_name
from fmd.stages.state_functions import FunctionBuilder, combine_functions


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
    with as_input_error(scene_file, f"{key}.file", given.file):
        digest = digest_file(path)
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


def add_controllers(functions: FunctionBuilder) -> tuple[list[Link], list[SampledController]]:
    """Give the controllers' names their meaning in formulas; return their states, and those that sample in order."""
    states, sampled, held = list[Link](), list[SampledController](), 0
    for name, controller in functions.scene.controller.items():
        if isinstance(controller, ExternalValue):
            functions.outputs[name] = HeldValue(held, controller.value)
            held += 1
            continue
        given = {key: functions.of_formula(controller, controller.parse(x)) for key, x in controller.formulas.items()}
        if isinstance(controller, LagController):
            functions.outputs[name] = output = JointValue(f"{name} output", 1)
            numbers: dict[str, Measured | float] = {"u": given["input"], "y": output, "T": controller.time_constant}
            states.append(controller_state(output.body, controller.start, combine_functions("(u - y)/T", numbers)))
        elif controller.sample_time is None:
            functions.outputs[name] = _continuous(name, controller, given, states)
        else:
            functions.outputs[name] = value = HeldValue(held)
            measured, file = tuple(given.values()), functions.scene.file
            law = fmu_law(controller, file, name) if isinstance(controller, FmuController) else sampled_law(controller)
            sampled.append(SampledController(name, controller.sample_time, measured, value, law))
            held += 1
    return states, sampled


def _continuous(
    name: str, controller: PidController, given: dict[str, StateFunction], states: list[Link]
) -> StateFunction:
    """Return the output of a continuous PID controller, whose states are added.

    They are the integral's part z of the output, ``dz/dt = integral e + (u − ū)/tracking`` with the output u within
    its limits and ū without, and the filtered error w, ``dw/dt = (e − w)/filter``, from the error at the start on.
    """
    kp, ki, kd = controller.proportional, controller.integral, controller.derivative
    parts: dict[str, Measured | float] = {"e": given["error"], "kp": kp, "ki": ki, "kd": kd}
    terms = ["kp*e"] if kp else []
    if controller.filters:
        assert controller.filter is not None
        parts |= {"w": JointValue(f"{name} filter", 1), "T": controller.filter}
        slope = combine_functions("(e - w)/T", parts)
        states.append(controller_state(f"{name} filter", given["error"], slope))
        terms.append("kd*(e - w)/T")
    elif kd:
        parts["rate"] = given["error_rate"]
        terms.append("kd*rate")
    if ki:
        parts["z"] = JointValue(f"{name} integral", 1)
        terms.append("z")
    output = wanted = combine_functions(" + ".join(terms), parts)
    if controller.highest is not None:
        output = combine_functions("min(u, limit)", {"u": output, "limit": controller.highest})
    if controller.lowest is not None:
        output = combine_functions("max(u, limit)", {"u": output, "limit": controller.lowest})
    if ki:
        slope = combine_functions("ki*e", parts)
        if controller.has_limits:
            assert controller.tracking is not None
            back: dict[str, Measured | float] = {"a": slope, "u": output, "v": wanted, "T": controller.tracking}
            slope = combine_functions("a + (u - v)/T", back)
        states.append(controller_state(f"{name} integral", 0.0, slope))
    return output


def sampled_law(given: PidController, sample_time: float | None = None) -> LinearLaw:
    """Return the law of a sampled PID controller for the error and, if that is measured, its rate.

    The memory is the integral's part of the output and the filtered error w. The integral adds up ``integral T e``; w
    follows the error as if that were constant over a sample time T, the controller's by default, ``w⁺ = a w + (1 − a)
    e`` with ``a = exp(−T/filter)``, and the derivative is ``(e − w)/filter``; without a filter ``(e − w)/T`` with the
    last error as w.
    """
    T = sample_time or given.sample_time
    assert T is not None
    kp, ki, kd = given.proportional, given.integral, given.derivative
    lowest = -math.inf if given.lowest is None else given.lowest
    highest = math.inf if given.highest is None else given.highest
    back = 0.0 if given.tracking is None or not given.has_limits else min(1.0, T / given.tracking)
    if given.filters:
        keep, by = (math.exp(-T / given.filter), kd / given.filter) if given.filter else (0.0, kd / T)
        A, B = ((1.0, 0.0), (0.0, keep)), ((ki * T,), (1.0 - keep,))
        return LinearLaw(A, B, (1.0, -by), (kp + by,), (back, 0.0), ((0.0,), (1.0,)), lowest, highest)
    rate = () if given.error_rate is None else (kd,)
    zeros = (0.0,) * len(rate)
    return LinearLaw(((1.0,),), ((ki * T, *zeros),), (1.0,), (kp, *rate), (back,), ((0.0, *zeros),), lowest, highest)
