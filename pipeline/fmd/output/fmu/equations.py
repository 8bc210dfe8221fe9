"""Generated sources of an FMU: sizes, tables and functions of its mechanism, and its integrator's coefficients."""

from collections.abc import Iterable, Sequence
from itertools import chain

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.shown import NUMBERS_A_LINE
from fmd.core.limits.stepping import DAMPED_STEP
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiler.c_source import write_c, write_c_parts, write_number
from fmd.dynamics.compiler.external import ExternalMechanism
from fmd.dynamics.compiler.signal_code import trace_signals
from fmd.integrators import dop853
from fmd.integrators.runge_kutta import RungeKutta
from fmd.integrators.step_control import groups_of, kinds_of
from fmd.output.fmu.variables import Interface

_THIRD, _FIFTH, _DENSE = 16, 17, 18  # rows of `dop853.ROWS` after those of the stages
_FAST, _WIDE = "accelerations", "accelerations_wide"


def write_equations(
    external: ExternalMechanism,
    interface: Interface,
    system: CompiledSystem,
    start: tuple[Array, Array],
    nominal: Array,
    token: str,
) -> dict[str, str]:
    """Write ``equations.h``, ``equations.c``, ``motion.c`` and ``signals.c``, by their names; steps call the last two.

    The start has positions (n_positions,) and rates (n,), ``nominal`` (n_positions + n,) sizes of all states; by the
    token the binary and its description know each other.
    """
    contents = _collect(external, interface, system, start, nominal)
    return {
        "equations.h": _write_header(external, contents, token),
        "equations.c": _write_tables(external, contents),
        "motion.c": _write_motion(external),
        "signals.c": write_c({"own_signals": trace_signals(external.signals)}),
    }


@dataclass(frozen=True)
class _Contents:
    """Constants by their names in C: of the preprocessor, tables of floating-point and whole numbers, and pairs."""

    constants: dict[str, str]
    tables: dict[str, Array]
    numbers: dict[str, IntArray]
    quaternions: list[str]


def _collect(
    external: ExternalMechanism,
    interface: Interface,
    system: CompiledSystem,
    start: tuple[Array, Array],
    nominal: Array,
) -> _Contents:
    """Collect what is fixed for a mechanism."""
    parameters = system.parameters
    groups, (kinds, n_kinds) = groups_of(system), kinds_of(system)
    sizes = {
        "N_POSITIONS": system.n_positions,
        "N_RATES": system.n,
        "N_STATES": system.n_positions + system.n,
        "N_OWN": len(external.signals),
        "N_SIGNALS": len(external.signals) + 6 * len(external.markers),
        "N_INPUTS": len(interface.input_places),
        "N_FIRST_MARKER_INPUT": interface.n_own_inputs,
        "N_CONSTANTS": len(external.constants),
        "N_PARAMETERS": len(interface.parameters),
        "N_OUTPUTS": len(external.quantities),
        "N_QUATERNIONS": len(parameters.quaternions),
        "N_GROUPS": int(groups.max(initial=-1)) + 1,
        "N_KINDS": n_kinds,
    }
    highest = system.highest_frequency if system.n else 0.0
    steps = {
        "FIRST_STEP": RungeKutta().start(system, *start).next_step,
        "LONGEST_STEP": DAMPED_STEP / highest if highest > 0.0 else np.inf,
    }
    return _Contents(
        constants={name: write_number(step) for name, step in steps.items()}
        | {name: str(size) for name, size in sizes.items()},
        tables={
            "start_states": np.concatenate(start),
            "nominal_states": nominal,
            "start_parameters": np.array(interface.parameters),
            "breakpoints": np.array([*system.breakpoints, np.inf]),
        },
        numbers={
            "input_places": np.array(interface.input_places, dtype=np.int64),
            "rate_positions": parameters.position,
            "groups": groups,
            "kinds": kinds,
        },
        quaternions=[f"{{{rate}, {position}}}" for rate, position in parameters.quaternions] or ["{0, 0}"],
    )


def _write_header(external: ExternalMechanism, contents: _Contents, token: str) -> str:
    """Write the declarations."""
    lines = [
        "/* Sizes, tables and functions of this mechanism. */",
        "#ifndef EQUATIONS_H",
        "#define EQUATIONS_H",
        "",
        f'#define MODEL_TOKEN "{token}"',
        *(f"#define {name} {value}" for name, value in contents.constants.items()),
        "",
        *(f"extern const double {name}[{max(1, len(values))}];" for name, values in contents.tables.items()),
        *(f"extern const int {name}[{max(1, len(values))}];" for name, values in contents.numbers.items()),
        f"extern const int quaternions[{len(contents.quaternions)}][2]; /* first rate, first position */",
        "",
        "/* Value, rate and acceleration of each of the scene's own loads and motions. */",
        "void own_signals(const double *const *in, double *const *out);",
        "",
        *(f"void {name}(const double *const *in, double *const *out);" for name in (*external.programs, _WIDE)),
        "",
        "#endif",
    ]
    return "\n".join(lines) + "\n"


def _write_tables(external: ExternalMechanism, contents: _Contents) -> str:
    """Write the tables, and all functions but those that steps call."""
    rare = {name: program for name, program in external.programs.items() if name != _FAST}
    lines = [
        "#include <math.h>",
        '#include "equations.h"',
        "",
        *(_table("double", name, map(write_number, values.tolist())) for name, values in contents.tables.items()),
        *(_table("int", name, map(str, values.tolist())) for name, values in contents.numbers.items()),
        f"const int quaternions[{len(contents.quaternions)}][2] = {{{', '.join(contents.quaternions)}}};",
        "",
        *chain(*write_c_parts(rare)),
    ]
    return "\n".join(lines) + "\n"


def _write_motion(external: ExternalMechanism) -> str:
    """Write the accelerations, for plain and for wide vector registers."""
    constants, plain = write_c_parts({_FAST: external.programs[_FAST]})
    _, wide = write_c_parts({_WIDE: external.programs[_FAST]})
    lines = [
        "#include <math.h>",
        '#include "equations.h"',
        '#include "wide.h"',
        "",
        *constants,
        *plain,
        "#if HAS_WIDE",
        *(f"WIDE {line}" if line.startswith(("void ", "static double ")) else line for line in wide),
        "#endif",
    ]
    return "\n".join(lines) + "\n"


def write_coefficients() -> str:
    """Write ``coefficients.h``: sums of slopes for the stages, the errors and the dense output of the integrator."""
    lines = [
        "/* Coefficients of the integrator: sums of slopes for stages 0 ... 15, two errors and the dense output. */",
        '#include "equations.h"',
        '#include "wide.h"',
        "",
        f"enum {{ THIRD = {_THIRD}, FIFTH = {_FIFTH}, DENSE = {_DENSE} }};",
        "static const double zeros[N_STATES];",
        f"static const double stage_times[{len(dop853.C)}] = {{{', '.join(map(write_number, dop853.C))}}};",
        "typedef void (*AddSlopes)(double h, double (*slopes)[N_STATES], const double *base, double *out);",
        *_slope_sums(""),
        "#if HAS_WIDE",
        *_slope_sums("_wide"),
        "#endif",
    ]
    return "\n".join(lines) + "\n"


def _slope_sums(suffix: str) -> list[str]:
    """Write a function for each row, and a table of them."""
    lines = []
    for k, row in enumerate(dop853.ROWS):
        terms = " + ".join(f"{_signed(weight)} * slopes[{slope}][i]" for slope, weight in row.items()) or "0.0"
        lines += [
            f"{'WIDE ' if suffix else ''}static void add_slopes{k}{suffix}"
            "(double h, double (*slopes)[N_STATES], const double *base, double *out)",
            "{",
            "    (void)slopes;",
            "    for (int i = 0; i < N_STATES; ++i)",
            f"        out[i] = base[i] + h * ({terms});",
            "}",
        ]
    names = ", ".join(f"add_slopes{k}{suffix}" for k in range(len(dop853.ROWS)))
    return [*lines, f"static const AddSlopes add_slopes{suffix}[] = {{{names}}};"]


def _signed(value: float) -> str:
    return f"({write_number(value)})" if value < 0.0 else write_number(value)


def _table(kind: str, name: str, entries: Iterable[str]) -> str:
    texts: Sequence[str] = list(entries) or ["0"]
    lines = [", ".join(texts[k : k + NUMBERS_A_LINE]) for k in range(0, len(texts), NUMBERS_A_LINE)]
    return f"const {kind} {name}[{len(texts)}] = {{" + ",\n    ".join(lines) + "};"
