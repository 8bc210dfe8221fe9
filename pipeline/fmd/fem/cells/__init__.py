"""The solid cells, one file for each shape: its geometry, its elements and its names in the files of other programs."""
