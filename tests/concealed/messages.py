"""The DataFlash messages of a run, as ArduRover 4.6.3 writes them: FRD axes, degrees, microseconds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tests.concealed.drive import COUNT, DWELL, FADE, PAUSE, PULSE, T_REC, W_MAX, W_MIN, Drive, Steering
from tests.concealed.motion import STEP
from tests.concealed.rover import Rng
from tests.concealed.sensors import Measured

Array = NDArray[np.float64]
Message = tuple[str, Mapping[str, ArrayLike]]
FIRMWARE = "ArduRover V4.6.3 (3fc7011a)"
LATITUDE, LONGITUDE, METRES_PER_DEGREE = -35.363, 149.165, 111_319.5


def messages(
    drive: Drive,
    steering: Steering,
    seen: Measured,
    filters: tuple[float, float],
    late: Mapping[str, float],
    rng: Rng,
) -> list[Message]:
    """All messages of the log. late: {"steering", "velocity"} s by which these streams are stamped late."""
    loop = _loop_samples(seen.t.size, 10)
    stamps = _stamps(drive, loop * STEP) + rng.integers(0, 60, loop.size)
    out = [*_head(drive, filters), *_inertial(seen, loop, stamps, late["velocity"], drive)]
    out += [
        _sweep(drive, steering, seen, late["steering"]),
        *_slow(drive, steering, seen, rng, late["steering"]),
    ]
    return out + _events(drive)


def _stamps(drive: Drive, t: ArrayLike) -> NDArray[np.int64]:
    """TimeUS of log times t [s]."""
    return np.round((drive.boot + np.asarray(t)) * 1e6).astype(np.int64)


def _loop_samples(n: int, every: int) -> NDArray[np.int64]:
    return np.arange(0, n, every)


def _degrees(angle: Array) -> Array:
    return np.rad2deg(np.arctan2(np.sin(angle), np.cos(angle)))


def _inertial(
    seen: Measured, k: NDArray[np.int64], stamps: NDArray[np.int64], late: float, drive: Drive
) -> list[Message]:
    g, a = seen.gyro[k], seen.accel[k]
    j = np.maximum(k - round(late / STEP), 0)  # a stream stamped late shows older values
    roll, yaw = np.rad2deg(seen.phi[k]), np.mod(_degrees(-seen.psi[k]), 360.0)
    north, west = seen.velocity[j].T
    place = seen.position[j].T
    return [
        ("ATT", {"TimeUS": stamps, "Roll": roll, "Pitch": 0.1, "Yaw": yaw, "AEKF": 3}),
        (
            "XKF1",
            {
                "TimeUS": stamps,
                "C": 0,
                "Roll": roll,
                "Pitch": 0.1,
                "Yaw": yaw,
                "VN": north,
                "VE": -west,
                "VD": 0.003,
                "PN": place[0],
                "PE": -place[1],
                "OH": 584.0,
            },
        ),
        (
            "IMU",
            {
                "TimeUS": stamps,
                "I": 0,
                "GyrX": g[:, 0],
                "GyrY": -g[:, 1],
                "GyrZ": -g[:, 2],
                "AccX": a[:, 0],
                "AccY": -a[:, 1],
                "AccZ": -a[:, 2],
                "T": 31.0,
                "GH": 1,
                "AH": 1,
                "GHz": 1000,
                "AHz": 1000,
            },
        ),
    ]


def _sweep(drive: Drive, steering: Steering, seen: Measured, late: float) -> Message:
    k = np.minimum((steering.t / STEP).astype(int), seen.t.size - 1)
    north, west = seen.velocity[k].T
    return "SWEP", {
        "TimeUS": _stamps(drive, steering.t + late),
        "Run": drive.number,
        "St": steering.state,
        "T": steering.clock,
        "Cmd": steering.cmd,
        "Out": steering.out,
        "VN": north,
        "VE": -west,
    }


def _slow(drive: Drive, steering: Steering, seen: Measured, rng: Rng, late: float) -> list[Message]:
    """RCOU, RCIN at 10 Hz and GPS at 5 Hz."""
    t = np.arange(0.05, seen.t[-1], 0.1)
    k = np.searchsorted(steering.t, t, "right") - 1
    pwm = np.where(k >= 0, steering.out[np.maximum(k, 0)], 1500)
    on = (t > drive.parked + drive.still) & (t < drive.stop + 0.5)
    throttle = np.where(on, np.round(1500 + 85 * drive.speed + rng.integers(-2, 3, t.size)), 1500)
    switch = np.where((t > drive.parked) & (t < drive.stop + 0.3), 2000, 1000)
    fixed: dict[str, ArrayLike] = {"C1": 1500, "C2": 1500, "C4": 1500, "C5": 1800, "C7": 1000, "C8": 1800}
    return [
        ("RCOU", {"TimeUS": _stamps(drive, t + late), "C1": pwm, "C3": throttle}),
        ("RCIN", {"TimeUS": _stamps(drive, t), **fixed, "C3": throttle, "C6": switch}),
        _satellites(drive, seen),
    ]


def _satellites(drive: Drive, seen: Measured) -> Message:
    k = np.arange(110, seen.t.size, 200)
    north, west = seen.velocity[np.maximum(k - 100, 0)].T  # a receiver's velocity is some 0.1 s old
    place = seen.position[np.maximum(k - 100, 0)].T
    latitude = LATITUDE + place[0] / METRES_PER_DEGREE
    longitude = LONGITUDE - place[1] / METRES_PER_DEGREE / np.cos(np.deg2rad(LATITUDE))
    return "GPS", {
        "TimeUS": _stamps(drive, seen.t[k]),
        "Status": 6,
        "GMS": 517_000_000 + 200 * np.arange(k.size),
        "GWk": 2445,
        "NSats": 12,
        "HDop": 0.8,
        "Lat": latitude,
        "Lng": longitude,
        "Alt": 584.0,
        "Spd": np.hypot(north, west),
        "GCrs": np.mod(np.rad2deg(np.arctan2(-west, north)), 360.0),
        "U": 1,
    }


def _parameters(drive: Drive, filters: tuple[float, float]) -> dict[str, float]:
    applet: dict[str, float] = {
        "ENABLE": 1,
        "TYPE": 0 if drive.kind == "sweep" else 1,
        "AMP": drive.amplitude_us,
        "WMIN": W_MIN,
        "WMAX": W_MAX,
        "TREC": T_REC,
        "FADE": FADE,
        "DWELL": DWELL,
        "STRAIGHT": drive.straight,
        "STILL": drive.still,
        "PULSE": PULSE,
        "PAUSE": PAUSE,
        "COUNT": COUNT,
        "PWM_MAX": 450,
        "ROLL_MAX": 40,
        "P_MAX": 300,
        "R_MAX": 200,
        "V_MIN": 0.5,
        "V_MAX": 5,
        "GCS": 0,
        "CHAN": 0,
        "RUN": drive.number,
    }
    firmware: dict[str, float] = {
        "FORMAT_VERSION": 16,
        "LOG_BITMASK": 65535,
        "LOG_DISARMED": 0,
        "LOG_FILE_DSRMROT": 1,
        "SCHED_LOOP_RATE": 100,
        "INS_GYRO_FILTER": filters[0],
        "INS_ACCEL_FILTER": filters[1],
        "INS_POS1_X": 0,
        "INS_POS1_Y": 0,
        "INS_POS1_Z": 0,
        "AHRS_TRIM_X": 0,
        "AHRS_TRIM_Y": 0,
        "AHRS_ORIENTATION": 0,
        "AHRS_EKF_TYPE": 3,
        "SERVO1_MIN": 1000,
        "SERVO1_MAX": 2000,
        "SERVO1_TRIM": 1500,
        "SERVO1_REVERSED": 0,
        "SERVO1_FUNCTION": 26,
        "SERVO3_MIN": 1000,
        "SERVO3_MAX": 2000,
        "SERVO3_TRIM": 1500,
        "SERVO3_REVERSED": 0,
        "SERVO3_FUNCTION": 70,
        "RC6_OPTION": 300,
        "SCR_ENABLE": 1,
        "MODE_CH": 8,
        "FS_GCS_ENABLE": 0,
        "MOT_SPD_SCA_BASE": 1,
    }
    return {**firmware, **{f"SWP_{name}": value for name, value in applet.items()}}


def _head(drive: Drive, filters: tuple[float, float]) -> list[Message]:
    now = _stamps(drive, 0.0)
    values = _parameters(drive, filters)
    return [
        (
            "PARM",
            {
                "TimeUS": np.full(len(values), now),
                "Name": _text(list(values)),
                "Value": list(values.values()),
                "Default": list(values.values()),
            },
        ),
        (
            "VER",
            {
                "TimeUS": now,
                "BT": 3,
                "BST": 65535,
                "Maj": 4,
                "Min": 6,
                "Pat": 3,
                "FWT": 255,
                "GH": 1070006554,
                "FWS": _text([FIRMWARE]),
                "BU": 1,
                "FV": 2,
            },
        ),
        ("MODE", {"TimeUS": now, "Mode": 0, "ModeNum": 0, "Rsn": 26}),
    ]


def _events(drive: Drive) -> list[Message]:
    off = drive.stop + 2.5 + 0.7 * drive.still_after
    rows = [
        (0.0, FIRMWARE),
        (0.0, "RC Protocol: SBUS"),
        (drive.parked, f"SWP: run {drive.number} stand still"),
        (drive.parked + drive.still, f"SWP: run {drive.number} drive at 0.5 to 5 m/s"),
        (drive.start, f"SWP: run {drive.number} start {drive.kind}"),
        (drive.stop, f"SWP: run {drive.number} steering is yours: stop"),
        (off - 0.5, f"SWP: run {drive.number} done"),
        (off, "Throttle disarmed"),
    ]
    end, gone = _stamps(drive, drive.length), _stamps(drive, off)
    blocks = np.arange(1.0, drive.length, 1.02)
    return [
        (
            "MSG",
            {"TimeUS": _stamps(drive, [t for t, _ in rows]), "Message": _text([text for _, text in rows])},
        ),
        ("EV", {"TimeUS": gone, "Id": 11}),
        ("ARM", {"TimeUS": gone, "ArmState": 0, "Method": 1}),
        (
            "DSF",
            {
                "TimeUS": np.minimum(_stamps(drive, blocks), end),
                "Dp": 0,
                "Blk": 2450,
                "Bytes": 103826,
                "FMn": 198761,
                "FMx": 204623,
                "FAv": 201772,
            },
        ),
    ]


def _text(lines: list[str]) -> NDArray[Any]:
    return np.array([line.encode() for line in lines])
