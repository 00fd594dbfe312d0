"""The Lua applet, its parameters as data, and parameter files with a reason on every line."""
