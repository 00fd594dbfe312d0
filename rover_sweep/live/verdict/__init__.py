"""The verdict on a run right after it: keep, repeat (with which amplitude), or discard."""
