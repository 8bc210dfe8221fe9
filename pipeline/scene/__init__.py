"""The scene: what a TOML file asks for, checked."""
