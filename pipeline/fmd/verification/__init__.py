"""Published and closed-form results, compared with those of this package."""
