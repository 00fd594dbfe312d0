"""Which effects to add: candidate fits, thresholds, look-alikes, bounds, intervals."""
