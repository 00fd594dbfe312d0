"""Decides after each run whether the missing effect is settled, and which run to drive next. Pure."""
