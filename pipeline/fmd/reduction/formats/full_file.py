"""Full matrices of a body with its nodes and modes, in files that scenes of matrices read."""

from pathlib import Path

import numpy as np

from fmd.fem.formats.matrix_files import write_matrices, write_modes
from fmd.fem.formats.matrix_model import MatrixModel
from fmd.reduction.formats.body_format import BodyFormat, ExportedBody


def _write(body: ExportedBody, path: Path) -> list[Path]:
    fe, modes = body.full_model()
    labels = fe.labels if isinstance(fe, MatrixModel) else np.arange(1, len(fe.x) + 1)
    beside = path.with_name(f"{path.stem}-modes.npz")
    written = write_matrices(path, fe, labels)
    write_modes(beside, labels, modes.frequencies_hz, modes.shapes)
    return [*written, beside]


FORMAT = BodyFormat(_write)
