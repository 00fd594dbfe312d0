"""The version, for import by every module."""

__version__ = "0.2.0"
