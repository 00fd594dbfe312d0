"""A vehicle on a link as the source of a screen."""
