"""Contact of flexible bodies: points, the flexibility that modes leave out, and forces by complementarity."""
