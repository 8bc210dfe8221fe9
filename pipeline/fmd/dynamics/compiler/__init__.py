"""Mechanisms traced into expression graphs, simplified, differentiated and compiled to machine code."""
