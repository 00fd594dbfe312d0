"""Spectra, averages and frequency responses of recorded signals, with coherence and random error."""
