"""Model structures M x' = F x + G u(t - tau): as data, and as a user's TOML text."""
