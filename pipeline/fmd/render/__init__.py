"""Pictures, films and charts, drawn from plain arrays; the only importer of PyVista and Matplotlib."""
