"""Option and argument types of the command line."""
