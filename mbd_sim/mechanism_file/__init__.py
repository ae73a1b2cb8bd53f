"""What a user writes: mechanism files read, checked, and made into records."""
