"""From a checked mechanism file to the records of a mechanism."""
