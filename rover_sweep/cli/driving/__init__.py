"""What the commands that drive a rover share: the session before the user's eyes, then the models."""
