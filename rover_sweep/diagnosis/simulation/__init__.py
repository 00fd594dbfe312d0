"""The simulation inside the diagnosis: models with effects, driven by a run's own steering and speed."""
