"""The pure core: recordings in, identified models out; no files, links, clocks or prints."""
