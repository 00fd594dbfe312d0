"""The pure core: recordings in, identified models out; no files, links, clocks or prints.

Called - `rover_sweep.identify(runs, ...)` - the package is the function `rover_sweep.api.identify`:
see there for its arguments.
"""
