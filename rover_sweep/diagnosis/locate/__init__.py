"""Where simulation and recording differ: places of the residual above the noise."""
