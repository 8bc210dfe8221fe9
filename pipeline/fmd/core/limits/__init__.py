"""Numbers that decide, one module a subject: tolerances, limits, safety factors and patience, each with its meaning."""
