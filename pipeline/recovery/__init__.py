"""What the coordinates mean: positions, energies and stress."""
