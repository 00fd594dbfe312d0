"""Commands that run in processes of their own while the session goes on."""
