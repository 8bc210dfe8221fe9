"""The page about the scene file, written from the types and docstrings of its tables."""
