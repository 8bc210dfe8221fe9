"""Finite elements: meshes, matrices, markers and files; the only importer of scikit-fem and meshio."""
