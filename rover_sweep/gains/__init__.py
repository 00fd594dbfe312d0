"""Steering-rate gains of ArduRover from an identified model: current and proposed gains, with reasons.

Pure functions from an identification (the document of `identification.json`) and the autopilot's parameters
to frozen values. Turn rates are in rad/s, positive to the right as in the firmware; `steering_chain.py`
describes the firmware and names its source files.
"""
