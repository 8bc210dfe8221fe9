"""One web page of all results: its contents, its template, and the viewer in it."""
