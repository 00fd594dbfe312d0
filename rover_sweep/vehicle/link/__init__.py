"""One MAVLink link: transport, framing, recording, signing, clock, streams."""
