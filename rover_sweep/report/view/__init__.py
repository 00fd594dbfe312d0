"""A page that plots any channel of a log against time or another channel."""
