"""Records of a mechanism from the checked data of its file."""
