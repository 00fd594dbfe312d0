"""Reports of a comparison of simulation and recordings, and of a corrected simulation."""
