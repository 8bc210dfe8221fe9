"""Settings of ready scenes whose tables of run times are of few modes alone: static responses take shorter steps."""

FEW_MODES: dict[str, tuple[str, ...]] = {
    "arm": ("body.forearm.modes.enrich=none",),
    "slider-crank": ("body.rod.modes.enrich=none",),
}


def few_modes(scene: str) -> tuple[str, ...]:
    """Return the overrides of a scene; none if it is measured as it stands."""
    return FEW_MODES.get(scene, ())
