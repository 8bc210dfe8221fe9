"""The results of a scene in Python and in notebooks: its quantities, figures, pictures and files."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmd.accuracy.error_budget import Budget, state_errors
from fmd.accuracy.solved_scene import SolvedScene
from fmd.core.arrays import Array
from fmd.core.cache import Cache
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.core.limits.shown import MANY_BODIES
from fmd.core.progress import Bars, Monitor, silent
from fmd.output.notebook import Animation, Picture, Summary, draw_inline, read_output
from fmd.output.pictures import draw_film
from fmd.output.summary import summarise_solved
from fmd.output.variable_errors import VariableErrors
from fmd.output.write import write_results
from fmd.recovery.motion_file import motion_dataset
from fmd.scene.scene import Scene, load_scene
from fmd.stages.part import FlexiblePart

if TYPE_CHECKING:
    import xarray
    from scipy.sparse import csr_array

    from fmd.dynamics.compiled_system.system import CompiledSystem
    from fmd.fem.joined import AnyMesh
    from fmd.fem.model import FEModel
    from fmd.fem.surface import SurfaceTopology
    from fmd.recovery.motion import Motion
    from fmd.recovery.stress import StressHistory
    from fmd.reduction.body import FlexibleBody
    from fmd.reduction.modes import Modes
    from fmd.stages.linear_model import LinearModel
    from fmd.stages.store import Log


@dataclass(frozen=True)
class BodyMatrices:
    """Finite element matrices of a flexible body and its modes, each computed when it is first asked for."""

    part: FlexiblePart  # the body with all its stages: mesh, reduced body, stress

    @property
    def x(self) -> Array:
        """Node positions, shape (n_nodes, 3) [m]."""
        return self.part.fe.x

    @property
    def K(self) -> csr_array:
        """Stiffness matrix, shape (3 n_nodes, 3 n_nodes) [N/m]; unknown ``3 i + a`` is node i along axis a."""
        return self.part.fe.K

    @property
    def M(self) -> csr_array:
        """Consistent mass matrix, shape (3 n_nodes, 3 n_nodes) [kg]."""
        return self.part.fe.M

    @property
    def Phi(self) -> Array:
        """Mode shapes with unit modal mass, ``Φᵀ M Φ = 1``, shape (3 n_nodes, n_modes) [kg^-1/2]."""
        return self.part.modes.shapes.reshape(-1, len(self.part.modes.omega))

    @property
    def frequencies_hz(self) -> Array:
        """Natural frequencies of the modes [Hz], shape (n_modes,)."""
        return self.part.modes.frequencies_hz


class Result(SolvedScene):
    """Results of a scene, each computed on first use and with the accuracy that the scene wants.

    Parameters are those of `fmd.solve`. What is said of one body is said of the first flexible one; all others are in
    `run`, the stages of the scene as it is computed.
    """

    def __repr__(self) -> str:
        scene = self.scene
        bodies = ", ".join(scene.body) if len(scene.body) < MANY_BODIES else f"{len(scene.body)} bodies"
        return f"Result({scene.name}: {scene.title}; {bodies})"

    def _repr_html_(self) -> str:
        return self.scene._repr_html_()

    @property
    def parts(self) -> Mapping[str, BodyMatrices]:
        """Flexible bodies by name, each with matrices ``K`` and ``M``, mode shapes ``Phi`` and ``frequencies_hz``."""
        return {name: BodyMatrices(part) for name, part in self.run.wholes.items()}

    @property
    def mesh(self) -> AnyMesh:
        """Mesh of the first flexible body."""
        return self.run.mesh

    @property
    def fe(self) -> FEModel:
        """Stiffness and mass of the first flexible body's mesh."""
        return self.run.fe

    @property
    def modes(self) -> Modes:
        """Modes of the first flexible body."""
        return self.run.modes

    @property
    def body(self) -> FlexibleBody:
        """First flexible body, reduced and, where it matters, stiffened."""
        return self.run.body

    @property
    def bodies(self) -> Mapping[str, FlexibleBody]:
        """Reduced flexible bodies by name."""
        return self.run.bodies

    @property
    def surface(self) -> SurfaceTopology:
        """Outer surface of the first flexible body."""
        return self.run.surface

    @property
    def system(self) -> CompiledSystem:
        """Equations of motion as compiled functions."""
        return self.run.system

    @property
    def start(self) -> tuple[Array, Array]:
        """Positions (n_positions,) and rates (n,) at the start."""
        return self.run.start

    @property
    def motion(self) -> Motion:
        """Motion by the scene's first run."""
        return self.run.motion

    @property
    def motions(self) -> Mapping[str, Motion]:
        """Motion by each of the scene's runs, under a label of integrator and ratio."""
        return self.run.motions

    def to_xarray(self) -> xarray.Dataset:
        """Return the motions of all runs as a labelled data set with units, as docs/results.md describes it.

        Their errors are among the attributes once the budget is computed.
        """
        return motion_dataset(self.motions, VariableErrors(self.run).of)

    @property
    def stress(self) -> StressHistory:
        """Stress on the first flexible body's surface over the first run's motion."""
        return self.run.stress

    @property
    def log(self) -> Log:
        """Time and origin of each stage's results."""
        return self.run.log

    @property
    def budget(self) -> Budget:
        """Error budget of the scene's first run."""
        return state_errors(self.run)

    @cached_property
    def summary(self) -> Summary:
        """Figures of the run as in ``summary.json``, without the error budget, which is `budget`."""
        return Summary(summarise_solved(self))

    def linearise(self, inputs: Sequence[str], outputs: Sequence[str], about: str = "start") -> LinearModel:
        """Linearise the scene about a state, with inputs and outputs by the names that docs/responses.md lists.

        Raises
        ------
        InputError, AccuracyError
            As `fmd.stages.linear_model.linearise_scene`.
        """
        from fmd.stages.linear_model import linearise_scene

        return linearise_scene(self.run, inputs, outputs, about)

    def film(self, **settings: Any) -> Animation:
        """Film the mechanism, to be played inline: ``film(scale=10, frames=40)``.

        Parameters
        ----------
        settings
            Keys of an ``[[output]]`` of type ``"film"``; 60 frames at 20 a second by default.

        Raises
        ------
        InputError
            There is no such key, or the scene lacks what it shows.
        """
        output = read_output({"type": "film", "file": "film.mp4", "frames": 60, "rate": 20.0, **settings})
        with tempfile.TemporaryDirectory(prefix="fmd-") as name:
            draw_film(self.run, output, Path(name))
            return Animation((Path(name) / output.file).read_bytes())

    def picture(self, type: str, mode: int = 1, **settings: Any) -> Picture:
        """Draw the picture of an ``[[output]]`` of this type, to be shown inline: ``picture("stress", scale=10)``.

        Parameters
        ----------
        type : str
            ``"chart"``, ``"mesh"``, ``"modes"``, ``"mode sheet"``, ``"stress"`` or ``"mechanism"``.
        mode : int
            Number of the mode, from 1.
        settings
            The output's other keys; ``body`` is the first flexible one by default.

        Raises
        ------
        InputError
            There is no such output or mode, or the scene lacks what it shows.
        """
        drawn = draw_inline(self.run, type, [mode], **settings)
        if not drawn:
            raise InputError("picture", "mode", mode, f"must be 1 … {len(self.modes.omega)}")
        return drawn[0]

    def write(self, folder: str | Path, pictures: bool = True, budget: bool = True) -> Summary:
        """Write all files that ``fmd run`` writes into a folder, and return the figures of ``summary.json``.

        Raises
        ------
        InputError, AccuracyError
            As `fmd.output.write.write_results`.
        """
        return Summary(write_results(self, Path(folder), pictures, budget))


def solve(scene: Scene, cache: Cache | None = None, monitor: Monitor = silent, keep_all: bool = False) -> Result:
    """Return the results of a scene, each of which is computed when it is first asked for.

    Parameters
    ----------
    scene : Scene
        As `fmd.load_scene` returns it.
    cache : Cache, optional
        Where results of stages are kept; the user's cache folder by default.
    keep_all : bool
        Integrate modes that nothing can excite, too.
    """
    return Result(scene, cache, monitor, keep_all)


def load(scene: str | Path | Mapping[str, Any], *overrides: str) -> Result:
    """Load a scene, ready to be computed: ``load("beam", "body.beam.length=300mm")``.

    Parameters
    ----------
    scene : str, Path or mapping
        A ready scene's name, the path of a TOML file, or the tables of such a file.
    overrides : str
        As for ``--set``.

    Raises
    ------
    InputError
        As `fmd.load_scene`.
    """
    return solve(load_scene(scene, overrides), monitor=Bars())
