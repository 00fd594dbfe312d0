"""The report of a season: a page for the fleet, a page for each vehicle, tables for other programs."""
