"""Compiled kernels over stress histories: principal values, extremes over time, rainflow counting."""
