"""Probabilities of explanations: sets of effects, no effect, and something unnamed."""
