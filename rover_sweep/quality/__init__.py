"""Checks of recordings: coherence, and faults that are not obvious. Commands and screens call `faults`."""
