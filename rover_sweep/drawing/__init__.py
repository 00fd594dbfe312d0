"""Draws runs, responses, models, diagnoses and simulations on matplotlib axes: `.plot()` of the results.

Each function takes the user's axes, or makes a figure with pyplot, and returns the axes. Results find it by
name (`rover_sweep.data.recording`), so only the first picture imports matplotlib.
"""
