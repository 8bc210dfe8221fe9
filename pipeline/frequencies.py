"""A scene's frequencies beside its reference."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from pipeline.stages import Pipeline


def frequency_table(run: Pipeline) -> dict[str, Any]:
    """Gather what the modes stage found and how far it is from the scene's reference."""
    found = run.modes.frequencies_hz
    wanted = np.array(run.scene.reference.frequencies if run.scene.reference else ())[: len(found)]
    return {
        "frequencies_hz": found.tolist(),
        "reference_hz": wanted.tolist(),
        "relative_error": (found[: len(wanted)] / wanted - 1).tolist(),
        "rigid_modes": run.modes.n_rigid,
        "mode_numbers": list(run.modes.numbers),
        "dofs": run.modes.dofs,
        "residual": run.modes.residual,
    }
