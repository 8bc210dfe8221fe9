"""Motion in space, energies and stress, recovered from generalised coordinates."""
