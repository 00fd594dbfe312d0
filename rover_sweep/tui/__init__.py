"""Terminal UI of a session: shows the messages of a `live.source.Source`, sends it the user's requests."""
