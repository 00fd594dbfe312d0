"""Data types that the other packages exchange: recordings, geometry, vehicle file, intervals, tables."""
