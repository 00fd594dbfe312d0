"""Models for other programs: python-control, MATLAB, JSON, the simulated rover."""
