"""A season of a fleet: the logs of each vehicle over many days, and which of its quantities drifted."""
