"""Identifies the steering from any driving, without a sweep: output-error fit of a simple law."""
