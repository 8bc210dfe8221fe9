"""Run time against error, and stress tests of stability."""
