"""Superelements for Simscape Multibody as MATLAB's files."""

from pathlib import Path

import numpy as np

from fmd.core.files import whole_file
from fmd.reduction.craig_bampton import Superelement
from fmd.reduction.formats.body_format import BodyFormat


def write_simscape(path: Path, element: Superelement) -> None:
    """Write what Simscape's block *Reduced Order Flexible Solid* asks for, as a MATLAB file.

    It holds ``origins`` (k, 3) [m] and ``quaternions`` (k, 4) of the interface frames, whose axes are the part's;
    ``names`` (k, 1); ``K``, ``M`` and ``C``, in the order of `Superelement`; ``frequencies_hz`` of the fixed-interface
    modes.
    """
    from scipy.io import savemat

    k = len(element.origins)
    names = np.empty((k, 1), dtype=object)
    names[:, 0] = list(element.origins)
    arrays = {
        "origins": np.array(list(element.origins.values())),
        "quaternions": np.tile([1.0, 0.0, 0.0, 0.0], (k, 1)),
        "names": names,
        "K": element.K,
        "M": element.M,
        "C": element.D,
        "frequencies_hz": element.omega[:, None] / (2 * np.pi),
    }
    with whole_file(path) as part, part.open("wb") as stream:
        savemat(stream, arrays)


FORMAT = BodyFormat(lambda body, path: write_simscape(path, body.superelement()))
