"""The state of the terminal UI as frozen values; draws nothing."""
