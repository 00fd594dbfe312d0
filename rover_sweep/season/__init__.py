"""A season of a fleet: the logs of each vehicle over many days, and the quantities that drifted."""
