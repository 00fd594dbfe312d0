"""Measures hundreds of logs, in local processes or on a Dask cluster, and writes the season of the fleet."""
