"""Converts .BIN, .tlog and .csv files to `Recording`s; the only room that knows ArduPilot's field names."""
