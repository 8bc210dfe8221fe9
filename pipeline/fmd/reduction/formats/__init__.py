"""Files of other multibody programs: reduced bodies that are written for them, and read from them."""
