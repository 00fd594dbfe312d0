"""One run: the right to move, the controls, the applet's reports, the outcome."""
