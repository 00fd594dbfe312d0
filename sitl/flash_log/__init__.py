"""DataFlash logs as ArduPilot writes them."""
