"""Benchmarks: run time against error, whole runs, and stress tests of stability."""
