"""Kernels: functions in a small subset of Python, translated to LLVM's language and compiled when first called."""
