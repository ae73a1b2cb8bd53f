"""What several commands share: arguments, progress, outputs."""
