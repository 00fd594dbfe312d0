"""Bench test with the front wheels off the ground: moves the steering, reads the road wheel's angle, and fits
the servo and the linkage."""
