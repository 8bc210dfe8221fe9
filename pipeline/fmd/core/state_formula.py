"""Formulas of a mechanism's state in a scene, parsed into postfix programs like those of `fmd.core.formula`."""

import ast
from collections.abc import Collection
from functools import lru_cache

from fmd.core.data_classes import dataclass
from fmd.core.formula import OF_TIME, Formula, Part, TimeReader, parse_text, read_guarded
from fmd.core.limits.scene import FORMULAS_KEPT

CHOOSE = 20  # pops a weight, the value where it is above 0, the value elsewhere
VARIABLE, CURVE = 1 << 8, 1 << 12  # the first variable of a state, and the first curve, which takes its argument


@dataclass(frozen=True, slots=True)
class StateFormula:
    """A formula of a mechanism's state and of the time as a postfix program."""

    # Operations on the stack: those of `Formula` without the time, ``CHOOSE``, ``VARIABLE + k`` for the k-th variable
    # and ``CURVE + k`` for the k-th curve at what was last on the stack.
    codes: tuple[int, ...]
    constants: tuple[float, ...]  # values of the codes ``CONSTANT``, in order
    # Names as written, ``"q"`` or ``"arm.tip.x"``, and all parts that depend on the time alone.
    variables: tuple[str | Formula, ...]
    curves: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables that aren't parts of the time alone."""
        return tuple(name for name in self.variables if isinstance(name, str))


def parse_state_formula(text: str, curves: Collection[str] = ()) -> StateFormula:
    """Parse a formula of the time and of named variables: ``"-k*(shoulder.angle - ref(t)) - c*rate"``.

    Beside what `parse_formula` takes it has names of variables, which may have dots; whether there are such ones is for
    others to check. Curves are called with one value; ``ref(t)`` is the variable ``ref`` itself.

    Raises
    ------
    ValueError
        As for `parse_formula`.
    """
    tree = parse_text(text)
    reader = _StateReader(curves)
    part = read_guarded(reader, tree)
    return StateFormula(part.codes, part.constants, tuple(reader.variables), tuple(reader.curves))


@lru_cache(maxsize=FORMULAS_KEPT)
def depends_on_state(text: str) -> bool:
    """Tell whether a formula has names other than t, constants and functions; False if it is no formula."""
    try:
        tree = parse_text(text)
    except ValueError:
        return False
    return not _names_in(tree) <= OF_TIME


def _names_in(node: ast.expr) -> set[str]:
    """Return the names in a formula, those with dots as they are written."""
    inner = {id(child.value) for child in ast.walk(node) if isinstance(child, ast.Attribute)}
    named = (child for child in ast.walk(node) if isinstance(child, ast.Name | ast.Attribute))
    return {ast.unparse(child) for child in named if id(child) not in inner}


class _StateReader(TimeReader):
    """Translates formulas of a state: what depends on the time alone becomes one variable of it."""

    def __init__(self, known_curves: Collection[str]) -> None:
        super().__init__()
        self._known_curves = known_curves
        self.variables: list[str | Formula] = []
        self.curves: list[str] = []

    def read(self, node: ast.expr) -> Part:
        """Translate a node and all below it."""
        names = _names_in(node)
        if "t" in names and names <= OF_TIME:
            return self._variable(TimeReader().formula(node))
        match node:
            case ast.Name(id=name) if name not in OF_TIME:
                return self._variable(name)
            case ast.Attribute():
                return self._variable(ast.unparse(node))
            case ast.Call(func=ast.Name() | ast.Attribute() as function, args=[value], keywords=[]) if (
                name := ast.unparse(function)
            ) not in OF_TIME:
                if isinstance(value, ast.Name) and value.id == "t":
                    return self._variable(name)
                if name in self._known_curves:
                    return self._curve(name, self.read(value))
        return super().read(node)

    def choose(self, test: ast.expr, then: Part, other: Part) -> Part:
        """Translate ``then if t < c else other``, with a weight that is a formula of the time."""
        if not _names_in(test) <= OF_TIME:
            mend = "of the state, min, max, abs and tanh can choose, e.g. (1 + tanh((x - x0)/width))/2 for x > x0"
            raise ValueError(f"at column {test.col_offset + 1}: a condition compares t with a constant; {mend}")
        weight = ast.IfExp(test=test, body=ast.Constant(1.0), orelse=ast.Constant(0.0))
        switch = self._variable(TimeReader().formula(ast.fix_missing_locations(ast.copy_location(weight, test))))
        return Part(
            other.codes + then.codes + switch.codes + (CHOOSE,),
            other.constants + then.constants,
            None,
            max(other.depth, 1 + then.depth, 3),
        )

    def _variable(self, variable: str | Formula) -> Part:
        if variable not in self.variables:
            self.variables.append(variable)
        return Part((VARIABLE + self.variables.index(variable),), (), None, 1)

    def _curve(self, name: str, argument: Part) -> Part:
        if name not in self.curves:
            self.curves.append(name)
        code = CURVE + self.curves.index(name)
        return Part((*argument.codes, code), argument.constants, None, argument.depth)
