"""What any driving, without a sweep, shows of the steering: an output-error fit of a simple law."""
