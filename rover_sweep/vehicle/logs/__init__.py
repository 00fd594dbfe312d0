"""The vehicle's own logs: listed, fetched, compared with the card."""
