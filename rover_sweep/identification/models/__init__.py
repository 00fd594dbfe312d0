"""The model structures of the paper: kinematic, bicycle, roll-yaw, lumped."""
