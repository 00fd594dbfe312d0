"""The session in a browser: one page, one program, which ends with either."""
