"""Commands that run in separate processes while the session continues."""
