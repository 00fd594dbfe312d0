"""The embedded rover's side of MAVLink: sessions, commands, messages, files, logs."""
