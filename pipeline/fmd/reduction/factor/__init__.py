"""Factors of large sparse symmetric matrices, with their size and memory known beforehand."""
