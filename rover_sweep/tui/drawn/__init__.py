"""Parts of a picture: text, bars, colours, labels, the question box."""
