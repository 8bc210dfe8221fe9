"""Warnings about runs whose slow and fast coordinates share their inertia."""

from __future__ import annotations

from fmd.core.limits.stability import STRONG
from fmd.stability.limits import inertial_coupling
from fmd.stages.pipeline import Pipeline


def coupling_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Warn of sub-cycled runs whose slow and fast coordinates couple through the mass matrix almost wholly."""
    found = []
    for label, plan in run.plans.items():
        system = plan.system
        if plan.integrator.substeps == 1 or not 0 < system.n_slow < system.n:
            continue
        beta = inertial_coupling(system.linear_matrices[0], system.n_slow)
        if beta > STRONG:
            text = (
                f"{label}: slow and fast coordinates share almost all of their inertia (β = {beta:.5g}, 1 - β² = "
                f"{1 - beta**2:.2g}), so this run's error can be far larger than that of central differences with the "
                "same fast step; compare it with a run by a method without sub-cycling, or take that"
            )
            found.append({"code": "inertial-coupling", "run": label, "text": text})
    return found
