"""The one orchestration that the command line, the terminal UI and users' Python call."""
