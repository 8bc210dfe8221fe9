"""Foundations of every other layer: errors, arrays, units, formulas, files and the cache."""
