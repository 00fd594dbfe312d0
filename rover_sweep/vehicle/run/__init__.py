"""One run: the right to move, what is moved, what the applet reports, how it ended."""
