"""Text forms of numbers, names, provenance and acceptance."""
