"""The error of a run's results, and how to meet a wanted accuracy."""
