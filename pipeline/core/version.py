"""Version of the package, for results and files that name what has made them."""

VERSION = "0.1.0"
