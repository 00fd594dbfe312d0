"""Drawing elements: text rows, bars, colours, labels, the question box."""
