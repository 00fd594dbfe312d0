"""A recorded drive through a simulation: its own steering and speed, and a recording of what comes of it."""
