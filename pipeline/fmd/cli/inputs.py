"""Objects that commands make of their options: a scene that is opened or solved, a quantity."""

import sys
from collections.abc import Sequence
from contextlib import suppress

from cyclopts import Parameter

from fmd.accuracy.solved_scene import SolvedScene
from fmd.cli.options import Json, NoCache, Set
from fmd.core.cache import Cache
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError, as_input_error
from fmd.core.progress import Bars
from fmd.core.units import to_si
from fmd.scene.magnitudes import find_unusual
from fmd.scene.scene import load_scene
from fmd.scene.source_files import load_repaired
from fmd.scene.variants import complete_for_linear_answers
from fmd.stages.pipeline import Pipeline


@Parameter(name="*")
@dataclass(frozen=True)
class Options:
    """Options of every command that computes a scene."""

    set_: Set = None
    no_cache: NoCache = False
    json: Json = False

    def open(
        self,
        scene: str,
        *,
        repair: bool = False,
        keep_all: bool = False,
        without: Sequence[str] = (),
        linear: bool = False,
    ) -> SolvedScene:
        """Load a scene, to be solved with progress bars on the terminal; says its unusual values before anything runs.

        Tables ``without`` are left out unread; ``linear`` answers need no simulation in the scene.
        """
        given = self.set_ or ()
        loaded = load_repaired(scene, given) if repair else load_scene(scene, given, without)
        if linear:
            loaded = complete_for_linear_answers(loaded)
        for text in find_unusual(loaded):
            print(f"warning: {text}", file=sys.stderr)
        return SolvedScene(loaded, Cache(None) if self.no_cache else None, Bars(), keep_all)

    def solve(self, scene: str, *, repair: bool = False, spare: Sequence[Sequence[str]] = ()) -> Pipeline:
        """Return the stages of a scene as it is computed.

        Parameters
        ----------
        repair : bool
            Mend meshes from files.
        spare : sequence of sequence of str
            Tables of the first level that the command doesn't need: where the whole scene has a fault they are left
            out, one set after the other, until the rest is sound.
        """
        try:
            solved = self.open(scene, repair=repair)
        except InputError as fault:
            for tables in () if repair else spare:
                with suppress(InputError):
                    solved = self.open(scene, without=tables)
                    print(f"fmd: left out, since this doesn't need it: {fault}", file=sys.stderr)
                    break
            else:
                raise
        return settle(solved)


DEFAULTS = Options()


def settle(solved: SolvedScene) -> Pipeline:
    """Return the stages of a solved scene, for commands that print no summary; warns of an accuracy that isn't met."""
    if solved.settings.unmet:
        print(f"warning: {solved.settings.unmet}", file=sys.stderr)
    return solved.run


def read_quantity(option: str, text: str, kind: str, *, above_zero: bool = False) -> float:
    """Read a quantity from the command line, in SI units.

    Raises
    ------
    InputError
        The text is no quantity of this kind, or isn't above zero.
    """
    with as_input_error(option, "", text):
        value = to_si(text, kind)
    if above_zero and not value > 0:
        raise InputError(option, "", text, "must be above zero")
    return value
