"""Redrive: a recorded drive repeated in simulation with its steering and speed, and the new recording."""
