"""Factors of large sparse symmetric matrices."""
