"""The command line: a file per command; `types` reads arguments, `views` prints, `driving` is shared."""
