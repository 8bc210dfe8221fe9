"""Derivatives of results by the numbers of a scene, fits of these to measurements, and best designs."""
