"""All results of a scene as one web page that needs nothing but a browser."""
