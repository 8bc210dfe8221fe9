"""Time integrators: one file a method, one protocol."""
