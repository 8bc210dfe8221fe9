"""Derivatives of results by the numbers of a scene, and fits of these numbers to measurements."""
