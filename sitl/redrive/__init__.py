"""Drives a recorded drive's own steering and speed through a simulated rover, and records that."""
