"""What the user describes: files, their validation, and the records made of them."""
