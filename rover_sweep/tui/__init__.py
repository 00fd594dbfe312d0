"""Terminal UI of a session: shows the messages of a `live.source.Source`, and sends requests to it."""
