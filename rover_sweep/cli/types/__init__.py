"""Values of the command line: options and arguments as the commands need them."""
