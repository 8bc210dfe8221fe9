"""Modes, enrichment, joint-conforming frames and the inertia Gram tensor: from K and M to a reduced body."""
