"""Steering-rate gains of ArduRover out of an identified model: what it flies now, what it should, and why.

Pure: an identification (as the document of `identification.json`) and the autopilot's parameters in,
frozen values out. Turn rates are in rad/s, positive to the right as in the firmware; `firmware.py` says
what the firmware does and where that was read.
"""
