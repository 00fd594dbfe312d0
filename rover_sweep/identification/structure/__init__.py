"""Model structures M x' = F x + G u(t - tau): as Python objects, and read from a user's TOML text."""
