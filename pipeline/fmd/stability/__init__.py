"""Largest stable steps and growth of vibrations, computed for a mechanism and a scheme."""
