"""The twin: a simulation that is compared with recordings, corrected, and driven again."""
