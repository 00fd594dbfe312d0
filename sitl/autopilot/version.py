"""Version that the embedded rover reports: its rules are those of this ArduRover."""

VERSION = (4, 6, 3)
FIRMWARE = "ArduRover V4.6.3 (embedded)"
OFFICIAL_RELEASE = 255  # FIRMWARE_VERSION_TYPE_OFFICIAL
