"""ArduRover's parameters that have an effect in the embedded rover, with the firmware's defaults.

Types and defaults are those of the sources of Rover-4.6.3 (Rover/Parameters.cpp and the libraries'
var_info tables). SIM_RC_FAIL is the simulator's: 0 the transmitter works, 1 no pulses, 2 throttle 950.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

Kind = Literal["int8", "int16", "int32", "float"]
Row = tuple[str, float, Kind]

GENERAL: tuple[Row, ...] = (
    ("FORMAT_VERSION", 16, "int16"),
    ("SYSID_THISMAV", 1, "int16"),
    ("SYSID_MYGCS", 255, "int16"),
    ("INITIAL_MODE", 0, "int8"),
    ("CRUISE_SPEED", 2, "float"),
    ("CRUISE_THROTTLE", 50, "int8"),
    ("PILOT_STEER_TYPE", 0, "int8"),
    ("MANUAL_OPTIONS", 0, "int8"),
    ("MANUAL_STR_EXPO", 0, "float"),
    ("TURN_RADIUS", 0.9, "float"),
    ("FRAME_CLASS", 1, "int8"),
    ("ARMING_CHECK", 1, "int32"),
    ("ARMING_REQUIRE", 1, "int8"),
    ("ARMING_RUDDER", 2, "int8"),
    ("BRD_SAFETY_DEFLT", 0, "int8"),
    ("SCHED_LOOP_RATE", 50, "int16"),
    ("STAT_BOOTCNT", 0, "int16"),
)
FAILSAFES: tuple[Row, ...] = (
    ("FS_ACTION", 2, "int8"),
    ("FS_TIMEOUT", 1.5, "float"),
    ("FS_THR_ENABLE", 1, "int8"),
    ("FS_THR_VALUE", 910, "int16"),
    ("FS_GCS_ENABLE", 0, "int8"),
    ("FS_GCS_TIMEOUT", 5, "float"),
    ("FS_OPTIONS", 0, "int32"),
    ("FS_CRASH_CHECK", 0, "int8"),
    ("FS_EKF_ACTION", 1, "int8"),
)
INERTIAL: tuple[Row, ...] = (
    ("INS_GYRO_FILTER", 4, "int16"),
    ("INS_ACCEL_FILTER", 10, "int16"),
    ("INS_POS1_X", 0, "float"),
    ("INS_POS1_Y", 0, "float"),
    ("INS_POS1_Z", 0, "float"),
    ("INS_RAW_LOG_OPT", 0, "int32"),
    ("INS_HNTCH_ENABLE", 0, "int8"),
    ("INS_FAST_SAMPLE", 1, "int8"),
    ("AHRS_EKF_TYPE", 3, "int8"),
    ("AHRS_ORIENTATION", 0, "int8"),
    ("EK3_ENABLE", 1, "int8"),
)
LOGGING: tuple[Row, ...] = (
    ("LOG_BITMASK", 65535, "int32"),
    ("LOG_BACKEND_TYPE", 1, "int8"),
    ("LOG_DISARMED", 0, "int8"),
    ("LOG_FILE_BUFSIZE", 200, "int16"),
    ("LOG_FILE_DSRMROT", 0, "int8"),
    ("LOG_REPLAY", 0, "int8"),
)
SCRIPTING: tuple[Row, ...] = (
    ("SCR_ENABLE", 0, "int8"),
    ("SCR_VM_I_COUNT", 10000, "int32"),
    ("SCR_HEAP_SIZE", 204800, "int32"),
    ("SCR_DEBUG_OPTS", 0, "int8"),
    ("SCR_DIR_DISABLE", 0, "int16"),
    ("SCR_THD_PRIORITY", 0, "int8"),
    *((f"SCR_USER{n}", 0.0, "float") for n in range(1, 7)),
)
MOTORS: tuple[Row, ...] = (
    ("MOT_SPD_SCA_BASE", 1, "float"),
    ("MOT_SLEWRATE", 100, "int16"),
    ("MOT_SAFE_DISARM", 0, "int8"),
    ("MOT_THR_MIN", 0, "int8"),
    ("MOT_THR_MAX", 100, "int8"),
    ("ATC_STR_RAT_FF", 0.2, "float"),
    ("ATC_STR_RAT_P", 0.2, "float"),
    ("ATC_STR_RAT_I", 0.2, "float"),
    ("ATC_STR_RAT_D", 0, "float"),
    ("ATC_STR_RAT_IMAX", 1, "float"),
    ("ATC_STR_RAT_MAX", 120, "float"),
    ("ATC_STR_ACC_MAX", 120, "float"),
    ("ATC_TURN_MAX_G", 0.6, "float"),
)
RADIO: tuple[Row, ...] = (
    ("RC_OVERRIDE_TIME", 3, "float"),
    ("RC_OPTIONS", 32, "int32"),
    ("RCMAP_ROLL", 1, "int8"),
    ("RCMAP_PITCH", 2, "int8"),
    ("RCMAP_THROTTLE", 3, "int8"),
    ("RCMAP_YAW", 4, "int8"),
    ("MODE_CH", 8, "int8"),
    *((f"MODE{n}", 0, "int8") for n in range(1, 7)),
    ("SIM_RC_FAIL", 0, "int8"),
)
STREAMS = (
    "RAW_SENS",
    "EXT_STAT",
    "RC_CHAN",
    "RAW_CTRL",
    "POSITION",
    "EXTRA1",
    "EXTRA2",
    "EXTRA3",
    "PARAMS",
    "ADSB",
)
CHANNELS = range(1, 17)


def _channels() -> Iterator[Row]:
    for n in CHANNELS:
        dead_zone = 30 if n in (1, 3, 4) else 0  # Rover::init_rc_in
        yield from (
            (f"RC{n}_MIN", 1100, "int16"),
            (f"RC{n}_TRIM", 1500, "int16"),
            (f"RC{n}_MAX", 1900, "int16"),
            (f"RC{n}_REVERSED", 0, "int8"),
            (f"RC{n}_DZ", dead_zone, "int16"),
            (f"RC{n}_OPTION", 0, "int16"),
        )
        yield from (
            (f"SERVO{n}_MIN", 1100, "int16"),
            (f"SERVO{n}_MAX", 1900, "int16"),
            (f"SERVO{n}_TRIM", 1500, "int16"),
            (f"SERVO{n}_REVERSED", 0, "int8"),
            (f"SERVO{n}_FUNCTION", {1: 26, 3: 70}.get(n, 0), "int16"),
        )


def _streams() -> Iterator[Row]:
    for serial in (0, 1):
        for stream in STREAMS:
            rate = 10 if stream == "PARAMS" else 0 if stream == "ADSB" else 1
            yield f"SR{serial}_{stream}", rate, "int16"


def parameter_table() -> tuple[Row, ...]:
    """(name, default, type) of every parameter of the firmware that the embedded rover has."""
    rows = (*GENERAL, *FAILSAFES, *INERTIAL, *LOGGING, *SCRIPTING, *MOTORS, *RADIO, *_channels(), *_streams())
    return tuple((name, float(default), kind) for name, default, kind in rows)
