"""One scene at many values: its points, the workers that compute them, and the table of results."""
