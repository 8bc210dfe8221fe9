"""Which step is safe, computed for a mechanism."""
