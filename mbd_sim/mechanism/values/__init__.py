"""What the entries of a mechanism consist of: expressions, tables, laws, places in files."""
