"""What a set of runs would show before it is driven, and which runs to add."""
