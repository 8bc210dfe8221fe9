"""Scenes: TOML files that are read into immutable tables and checked as a whole."""
