"""Checks of a recording after reading: it is refused, or used with warnings."""
