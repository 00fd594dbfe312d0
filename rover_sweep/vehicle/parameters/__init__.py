"""Parameters of the vehicle: read, written, compared, put back after an override."""
