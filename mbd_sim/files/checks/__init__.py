"""Problems of a file, and changes of its values."""
