"""Planning of runs: which effects a set of runs can detect and separate, and which runs to add."""
