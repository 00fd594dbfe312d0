"""What must be right before a run: one file for each group of checks."""
