"""Simulated rovers: the plant, the embedded autopilot, the real firmware started on the plant."""
