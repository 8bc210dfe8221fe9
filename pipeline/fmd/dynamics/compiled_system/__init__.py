"""A compiled mechanism as the system that integrators march."""
