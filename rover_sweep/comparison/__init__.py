"""Compares a simulation with recordings: where they differ, in which number, physics or instrument."""
