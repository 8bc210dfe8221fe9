"""Joints in a scene file, each kind in a file of its own, and the joints of any kind."""
