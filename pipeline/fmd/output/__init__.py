"""Results as files, pictures and pages."""
