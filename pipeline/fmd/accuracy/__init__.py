"""The error of a run's results, and how to meet a required accuracy."""
