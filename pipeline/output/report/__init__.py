"""One web page of all results."""
