"""Draws runs, responses, models, diagnoses and simulations on matplotlib axes: `.plot()` of the results.

Each function takes the user's axes, or makes a figure with pyplot, and returns the axes. It is found by its
address (`rover_sweep.data.recording`), so matplotlib is imported at the first picture only.
"""
