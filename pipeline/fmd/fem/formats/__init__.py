"""Readers and writers of meshes, matrices and results in the formats of other programs."""
