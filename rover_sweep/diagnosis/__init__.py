"""Where simulation and recordings differ, which physics is missing, and what it improves on held-out runs.

Pure functions: recordings in, frozen values out. The diagnosis has its own simulation; it and `sitl` do not
import each other.
"""
