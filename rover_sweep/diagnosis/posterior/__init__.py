"""Probabilities of explanations: sets of effects, none, and something that has no name."""
