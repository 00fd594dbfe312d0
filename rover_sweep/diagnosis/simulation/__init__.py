"""Simulation for the diagnosis: a model with effects, driven by the recorded steering and speed of a run."""
