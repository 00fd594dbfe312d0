"""The runs within a log: found, classified, checked for completeness."""
