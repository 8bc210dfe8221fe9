"""Shapes to Gmsh meshes. The only package that loads Gmsh (GPL); it imports nothing of ``pipeline``."""
