"""The checks before a run: one file for each group."""
