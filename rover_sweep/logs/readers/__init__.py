"""Columns and channels out of .BIN, .tlog and .csv; one file for each format and clock."""
