"""Converts .BIN, .tlog and .csv files to `Recording`s; only it knows ArduPilot's field names."""
