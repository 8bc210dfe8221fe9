"""A tree of rigid and flexible bodies."""
