"""One flexible body on a driven hinge."""
