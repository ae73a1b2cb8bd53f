"""Elements of XML files, with their lines."""
