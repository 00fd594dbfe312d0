"""Numbers, names, provenance and acceptance as written for people."""
