"""The session on a terminal: shows what a `live.source.Source` tells, asks it what a key says."""
