"""Which effects to add: scores, thresholds, look-alikes, bounds, rounds."""
