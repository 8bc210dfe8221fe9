"""From a scene to its results: one stage graph."""
