"""Published and closed-form results, compared with what the library finds."""
