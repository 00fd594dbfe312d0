"""Finds where simulation and recordings differ, the missing physics, and its gain on held-out runs.

Pure functions: recordings in, frozen values out. The diagnosis has its own simulation; it and `sitl` do not
import each other.
"""
