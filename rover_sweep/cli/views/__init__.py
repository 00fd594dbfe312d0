"""Output of the commands on a terminal, and their questions."""
