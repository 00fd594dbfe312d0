"""What the embedded rover says it is: its rules are those of this version of ArduRover."""

VERSION = (4, 6, 3)
FIRMWARE = "ArduRover V4.6.3 (embedded)"
OFFICIAL_RELEASE = 255  # FIRMWARE_VERSION_TYPE_OFFICIAL
