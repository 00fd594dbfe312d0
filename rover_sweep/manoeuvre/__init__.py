"""Test inputs in closed form: sweep, doublet, multisine, and the applet's parameters for each."""
