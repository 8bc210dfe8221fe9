"""One scene at many values: the points, the workers that compute them, what they found as a table."""
