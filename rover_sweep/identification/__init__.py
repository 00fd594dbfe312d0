"""From recordings to identified models, without files, links, clocks or prints."""
