"""Inertia of bodies along the one axis that they turn about, which forces of their joints take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from fmd.reduction.inertia import add_normal_blocks
from fmd.stages.part import FlexiblePart

if TYPE_CHECKING:
    from fmd.dynamics.mechanism import Mechanism


def complete_inertia(parts: Mapping[str, FlexiblePart], mechanism: Mechanism) -> Mechanism:
    """Add to bodies of a mechanism the inertia along the one axis that they turn about, from their parts by name."""
    links = [
        replace(link, integrals=add_normal_blocks(link.integrals, parts[link.name].inertia_along_normal))
        if link.integrals.normal >= 0
        else link
        for link in mechanism.links
    ]
    return replace(mechanism, links=links)
