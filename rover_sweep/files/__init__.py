"""Safe reading and writing of files: checked TOML and JSON, complete replacement, printable text."""
