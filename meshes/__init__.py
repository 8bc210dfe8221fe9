"""Gmsh meshes of shapes and CAD files; the only package that loads Gmsh (GPL), without imports of other rooms."""
