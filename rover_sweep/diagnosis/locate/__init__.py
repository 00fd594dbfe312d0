"""Where simulation and recording differ: what stands out of a residual."""
