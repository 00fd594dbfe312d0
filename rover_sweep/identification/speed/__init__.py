"""Response of the speed to the throttle, from throttle sweeps."""
