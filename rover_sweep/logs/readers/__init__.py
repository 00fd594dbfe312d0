"""Columns and channels of .BIN, .tlog and .csv; one file for each format and clock."""
