"""Errors of a run's results against those of a much finer run of the same scene, for tables and tests."""

import numpy as np

from fmd import Pipeline
from fmd.accuracy.details import detail_quantities
from fmd.accuracy.error_estimates import Quantity
from fmd.accuracy.estimators import Estimates
from fmd.accuracy.quantities import mesh_quantities, motion_quantities, stress_quantities


def true_errors(run: Pipeline, finer: Pipeline) -> dict[str, float]:
    """Return the relative errors of a run's quantities, but for those of joints and markers."""
    return {name: own.error(exact) for name, (own, exact) in compared_quantities(run, finer).items()}


def compared_quantities(run: Pipeline, finer: Pipeline, details: bool = False) -> dict[str, tuple[Quantity, Quantity]]:
    """Return the quantities of a run, each with that of a much finer one.

    Frequencies are matched by their modes' shapes, element stress by place. ``details`` adds joints and markers.
    """
    estimates, motion = Estimates(run), finer.motion
    places = {name: part.element_places for name, part in run.parts.items() if part.elements}
    exact = mesh_quantities(finer, run) | motion_quantities(motion, finer.fine_motion)
    if run.parts:
        exact |= stress_quantities(finer, motion, np.arange(len(motion.times)), places=places)
    if details:
        exact |= detail_quantities(finer.scene, motion)
    left_out = {*estimates.details} - ({*exact} if details else set())
    quantities = {name: own for name, own in estimates.quantities.items() if name not in left_out}
    return {name: (own, exact[name]) for name, own in quantities.items()}
