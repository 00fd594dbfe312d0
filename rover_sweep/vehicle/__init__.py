"""The vehicle behind a link: alone knows MAVLink, modes and PWM."""
