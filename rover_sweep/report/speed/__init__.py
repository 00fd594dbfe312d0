"""The response of the speed to the throttle: document, answer on the terminal."""
