"""Mesh, material, stiffness and mass, strain operators. The only importer of scikit-fem and meshio."""
