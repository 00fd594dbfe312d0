"""The simulated rover as files for other programs: one Python file, or an FMU."""
