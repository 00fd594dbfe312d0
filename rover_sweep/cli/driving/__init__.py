"""Shared by the commands that drive a rover: show the session, then identify and diagnose."""
