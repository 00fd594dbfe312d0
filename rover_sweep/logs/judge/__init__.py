"""What is said of a recording that was read: refused, or used with these warnings."""
