"""A simulation compared with recordings: where they differ, and which number, physics or instrument it is."""
