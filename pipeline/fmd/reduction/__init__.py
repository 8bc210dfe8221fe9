"""From stiffness and mass to a reduced body: modes, enrichment, frames at joints and inertia integrals."""
