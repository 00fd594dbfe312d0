"""The verdict on a run right after it: keep, repeat with what, or discard."""
