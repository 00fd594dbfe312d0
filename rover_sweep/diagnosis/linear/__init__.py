"""The linear part of an augmented model."""
