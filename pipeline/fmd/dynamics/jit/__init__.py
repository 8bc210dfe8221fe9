"""Compiled kernels: how they are built, called and kept."""
