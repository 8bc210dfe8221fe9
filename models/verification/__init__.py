"""The ready scenes: one TOML file each, and the paper's reference figures beside them."""
