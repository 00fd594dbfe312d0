"""Repeats a recorded drive's steering and speed on a simulated rover and records the result."""
