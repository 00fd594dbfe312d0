"""Concealed data: a simulated rover of its own that hides an effect in field-like `.BIN` logs, and the grading.

Shares no code with the tool or the project's plant: another integrator, another tyre law, another
servo, another DataFlash writer. `python -m tests.concealed --help` draws, conceals, diagnoses, grades.
Axes inside are ISO 8855 (x forward, y left, z up), SI units; FRD and microseconds begin in `messages`.
"""
