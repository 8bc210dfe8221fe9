"""Scenes to start one's own from."""
