"""Equations of motion as compiled kernels over flat arrays."""
