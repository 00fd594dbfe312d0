"""rover-sweep: finds out, in an afternoon on a car park, how a rover really steers."""

__version__ = "0.1.0"
