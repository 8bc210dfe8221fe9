"""Meshes, matrices and materials of bodies, from shapes, CAD and files; the only user of `meshes`."""
