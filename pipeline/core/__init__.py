"""What every other layer stands on: errors, arrays, units, formulas, files and the cache."""
