"""The embedded autopilot: modes, radio, parameters, Lua scripts, what it logs."""
