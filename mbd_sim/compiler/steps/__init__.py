"""The steps of each family of methods, and the loop over them."""
