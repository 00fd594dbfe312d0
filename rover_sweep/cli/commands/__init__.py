"""One file for each command, under its own name."""
