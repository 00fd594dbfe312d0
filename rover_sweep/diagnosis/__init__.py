"""Where simulation and recordings differ, which physics was left out, and what it gains on a fresh run.

Pure: recordings in, frozen values out. The simulation here is the diagnosis' own; `sitl` knows nothing
of it, nor it of `sitl`.
"""
