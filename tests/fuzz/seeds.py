"""Small undamaged files of every kind, made from one rover whose numbers are known."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from rover_sweep.data.recording import Recording
from rover_sweep.identification.models import roll_yaw
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.session.content import SessionRun
from rover_sweep.session.folder import DESCRIPTION, VEHICLE_FILE, Session
from rover_sweep.vehicle.link.mavlink import Codec
from tests.identification.synthetic import GEOMETRY, TRUE, driven
from tests.logs.flash_writer import FlashWriter

DATA = Path(__file__).parents[1] / "data"
VARIANTS = Path(__file__).parents[2] / "sitl" / "plant" / "variants"
SWEEP = Sweep(amplitude=120.0, w_min=1.0, w_max=25.0, t_rec=25.0)
RATE = 50.0  # Hz
SHORT = 12.0  # s of the run in the logs that cost little
TRIM, RAD_PER_US, SPEED = 1500.0, 0.001, 2.4
BEFORE = 2.0  # s of standing before the run
SLOW = 5  # samples of the gyro between those of what is logged slowly
PARAMETERS = {
    "SERVO1_FUNCTION": 26.0,
    "SERVO1_MIN": 1100.0,
    "SERVO1_MAX": 1900.0,
    "INS_GYRO_FILTER": 0.0,
    "INS_ACCEL_FILTER": 0.0,
    "SCHED_LOOP_RATE": 100.0,
    "SWP_AMP": 120.0,
    "SWP_WMIN": 1.0,
    "SWP_TREC": 25.0,
}
BANNER = "ArduRover V4.6.3 (3fc7011a)"
STATES = ((0.0, 3), (3.0, 4), (5.0, 5), (7.0, 6), (32.0, 7), (34.0, 8))  # (s of the override, state)


@dataclass(frozen=True)
class Drive:
    """Columns at `RATE` [SI, FRD as the autopilot logs them] from `BEFORE` s on."""

    t: np.ndarray
    pwm: np.ndarray
    r: np.ndarray
    p: np.ndarray
    ay: np.ndarray
    vy: np.ndarray
    psi: np.ndarray
    state: np.ndarray


@cache
def recording() -> Recording:
    """The rover's answer, with a little noise."""
    return driven(roll_yaw(GEOMETRY).with_values(TRUE), SWEEP, SPEED, 0.01, RAD_PER_US, RATE)


@cache
def drive(length: float) -> Drive:
    """Its first `length` s as columns."""
    run = recording()
    inside = run["r"].t < length
    t = run["r"].t[inside]
    delta = run["delta"]
    held = delta.x[np.searchsorted(delta.t, t, "right") - 1]
    times, numbers = (np.array(column) for column in zip(*STATES, strict=True))
    state = numbers[np.clip(np.searchsorted(times, t, "right") - 1, 0, None)]
    r = -run["r"].x[inside]
    psi = np.cumsum(r) / RATE
    return Drive(
        t + BEFORE,
        TRIM - held / RAD_PER_US,
        r,
        run["p"].x[inside],
        -run["ay"].x[inside],
        -run["vy"].x[inside],
        psi,
        state,
    )


def flash(length: float = np.inf) -> bytes:
    """A DataFlash log."""
    d, w = drive(length), FlashWriter()
    w.parameters(PARAMETERS)
    w.messages([BANNER])
    w.define("IMU", "QBfff", "TimeUS,I,GyrX,GyrZ,AccY")
    w.define("XKF1", "QBfff", "TimeUS,C,VN,VE,Yaw")
    w.define("RCOU", "QHH", "TimeUS,C1,C3")
    w.define("SWEP", "QHHfff", "TimeUS,Run,St,Cmd,Out,T")
    rows = zip(*(x.tolist() for x in (d.t, d.pwm, d.r, d.p, d.ay, d.vy, d.psi, d.state)), strict=True)
    for k in range(int(BEFORE * 10)):
        us = round(1e6 * k / 10)
        w.write("IMU", us, 0, 0.0, 0.0, 0.0)
        w.write("XKF1", us, 0, 0.0, 0.0, 0.0)
        w.write("RCOU", us, TRIM, 1500)
    w.write("MSG", round(1e6 * BEFORE), b"SWP: run 1 start sweep")
    for k, (t, pwm, r, p, ay, vy, psi, state) in enumerate(rows):
        us = round(1e6 * t)
        w.write("SWEP", us, 1, state, pwm, pwm, t - BEFORE)
        w.write("IMU", us, 0, p, r, ay)
        if k % SLOW == 0:
            vn, ve = _north_east(psi, vy)
            w.write("XKF1", us, 0, vn, ve, float(np.degrees(psi) % 360))
            w.write("RCOU", us, pwm, 1600)
    w.write("MSG", us + 1000, b"SWP: run 1 done")
    return w.data


def _north_east(psi: float, right: float) -> tuple[float, float]:
    vn = SPEED * np.cos(psi) - right * np.sin(psi)
    return float(vn), float(SPEED * np.sin(psi) + right * np.cos(psi))


def frames(length: float = np.inf) -> list[tuple[int, bytes]]:
    """(arrival [us], MAVLink frame) of the same drive."""
    d, codec, found = drive(length), Codec(1, 1), list[tuple[int, bytes]]()

    def said(t: float, name: str, /, **fields: Any) -> None:
        message = getattr(dialect, f"MAVLink_{name.lower()}_message")(**fields)
        found.append((round(1e6 * (1.7e9 + t)), codec.pack(message)))

    for n, (name, value) in enumerate(PARAMETERS.items()):
        known = {"param_type": 9, "param_count": len(PARAMETERS), "param_index": n}
        said(0.0, "PARAM_VALUE", param_id=name.encode(), param_value=value, **known)
    said(0.0, "STATUSTEXT", severity=6, text=BANNER.encode())
    rows = zip(*(x.tolist() for x in (d.t, d.pwm, d.r, d.p, d.ay, d.vy, d.psi, d.state)), strict=True)
    for k, (t, pwm, r, p, ay, vy, psi, state) in enumerate(rows):
        ms, us = round(1e3 * t), round(1e6 * t)
        still = dict.fromkeys(("roll", "pitch", "pitchspeed"), 0.0)
        said(t, "ATTITUDE", time_boot_ms=ms, yaw=psi, rollspeed=p, yawspeed=r, **still)
        none = dict.fromkeys(("xacc", "ygyro", "xmag", "ymag", "zmag"), 0)
        moved = {"yacc": _short(ay / 9.80665e-3), "xgyro": _short(1e3 * p), "zgyro": _short(1e3 * r)}
        said(t, "RAW_IMU", time_usec=us, zacc=-1000, **moved, **none)
        pulses = {f"servo{n}_raw": 0 for n in range(1, 9)} | {"servo1_raw": round(pwm), "servo3_raw": 1600}
        said(t, "SERVO_OUTPUT_RAW", time_usec=us, port=0, **pulses)
        if k % SLOW == 0:
            vn, ve = _north_east(psi, vy)
            said(t, "LOCAL_POSITION_NED", time_boot_ms=ms, x=0.0, y=0.0, z=0.0, vx=vn, vy=ve, vz=0.0)
            said(t, "NAMED_VALUE_FLOAT", time_boot_ms=ms, name=b"SWP_ST", value=float(state))
            said(t, "NAMED_VALUE_FLOAT", time_boot_ms=ms, name=b"SWP_RUN", value=1.0)
        if k % 50 == 0:
            beat = {"type": 10, "autopilot": 3, "base_mode": 128, "custom_mode": 0, "system_status": 4}
            said(t, "HEARTBEAT", mavlink_version=3, **beat)
    said(t, "STATUSTEXT", severity=6, text=b"SWP: run 1 done")
    return found


def _short(value: float) -> int:
    return round(min(max(value, -32768.0), 32767.0))


def telemetry(length: float = np.inf) -> bytes:
    """A .tlog."""
    return b"".join(struct.pack(">Q", us) + frame for us, frame in frames(length))


def stream() -> bytes:
    """What comes over the wire."""
    return b"".join(frame for _, frame in frames(SHORT))


def table(length: float = np.inf) -> bytes:
    """A .csv whose columns bear the channels' names (ISO axes)."""
    d = drive(length)
    lines = ["time,pwm,r,p,ay,vy,speed"]
    columns = (d.t, d.pwm, -d.r, d.p, -d.ay, -d.vy, np.full(d.t.size, SPEED))
    lines += [",".join(f"{x:.5g}" for x in row) for row in zip(*columns, strict=True)]
    return "\n".join(lines).encode() + b"\n"


def column_map() -> bytes:
    """Of `table`, in full."""
    return (
        b'time = {column = "time", unit = "s"}\npwm = "pwm"\nr = "r"\np = "p"\nay = "ay"\nvy = "vy"\n'
        b'speed = 2.4\naxes = "iso"\nsampling = "step"\nfilters = {gyro_hz = 0, accel_hz = 4}\n'
    )


def vehicle() -> bytes:
    """The vehicle file of the rover."""
    g = GEOMETRY
    return (
        f'[vehicle]\nname = "made"\nmass = {g.mass}\ncg_to_front_axle = {g.a}\ncg_to_rear_axle = {g.b}\n'
        f"sprung_mass = {g.sprung_mass}\ncg_height_above_roll_centre = {g.h}\n"
        f"roll_inertia = {{ value = {g.roll_inertia}, sd = 0.001 }}\n"
        f"[steering]\ntrim_us = {TRIM}\nrad_per_us = {RAD_PER_US}\n"
        f"[imu]\nposition = [{g.imu_x}, 0.0, {(g.h or 0.0) - g.imu_z}]\n"
        '[fit]\nfree = ["roll_inertia"]\n[material]\nservo_lag = 0.04\n'
    ).encode()


def structure() -> bytes:
    """A model of a user's own."""
    return (DATA / "structures" / "roll-yaw.toml").read_bytes()


def variant() -> bytes:
    """A simulated rover."""
    return sorted(VARIANTS.glob("*.toml"))[0].read_bytes()


def session(folder: Path) -> dict[str, bytes]:
    """The files of a session's folder {name: content}; it is made in `folder`."""
    opened = Session.open(folder)
    (folder / VEHICLE_FILE).write_bytes(vehicle())
    planned = SessionRun("sweep1", SWEEP, SPEED)
    opened.plan((planned, SessionRun("sweep2", SWEEP)))
    opened.on({"firmware": BANNER, "uid": 7})
    opened.set({"connect": "tcp:127.0.0.1:5760"}, PARAMETERS)
    opened.logs_before(((1, 1000, 0),))
    path = opened.tlog("sweep1")
    path.write_bytes(telemetry(SHORT))
    opened.begun(planned, path, True)
    opened.ended(path, "done", "the manoeuvre ran to its end", False, span=(2.0, 36.0), number=1)
    opened.judged(path, {"run": "sweep1", "verdict": "keep", "sentence": "keep"})
    opened.close()
    return {name: (folder / name).read_bytes() for name in (DESCRIPTION, VEHICLE_FILE, "sweep1.tlog")}


def models() -> bytes:
    """What `export` and `gains` read."""
    return json.dumps(_document()).encode()


@cache
def _document() -> dict[str, Any]:
    from rover_sweep.report.identification.identification_json import identification_document

    found = _result()
    return identification_document(found, found.origin)


@cache
def _result() -> Any:
    import rover_sweep as rs
    from rover_sweep.api.read import with_delta
    from rover_sweep.data.vehicle_file import parse

    rover = parse(vehicle().decode())
    run = recording()
    return rs.identify(rs.Runs((with_delta(run, rover),), rover), bootstrap=0)


def saved() -> bytes:
    """What `Result.save` writes."""
    from rover_sweep.api.save import dumps

    return dumps(_result()).encode()
