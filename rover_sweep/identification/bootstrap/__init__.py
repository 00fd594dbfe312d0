"""Confidence intervals of the parameters by a parametric bootstrap of the whole pipeline."""
