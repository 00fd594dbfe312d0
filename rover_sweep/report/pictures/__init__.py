"""The pictures of the reports, one file per kind."""
