"""Questions asked of a mechanism by integrating it many times."""
