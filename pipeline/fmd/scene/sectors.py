"""Sectors of cyclic bodies in a scene file."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from fmd.core.limits.scene import MOST_SECTORS
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.values import Text


class SectorMesh(SceneTable):
    """Keys of a mesh that may be that of one sector of a cyclic body, about the z axis."""

    # Number of sectors, 3 or more: the file has one of them, which is repeated.
    cyclic: Annotated[int, Field(strict=True, ge=3, le=MOST_SECTORS)] | None = None
    # The sector's two faces that one turn carries into each other; a mesh has nodes at the same places of both.
    cuts: tuple[Text, Text] | None = None

    def _check(self) -> None:
        if (self.cyclic is None) != (self.cuts is None):
            raise FaultError("belong together: cyclic = 6, cuts = ['low', 'high']", "cyclic")
