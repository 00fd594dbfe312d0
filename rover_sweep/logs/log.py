"""A whole log in SI units and ISO axes, before the runs in it have been told apart."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import ASSUMED, LowPass, Note, Signal
from rover_sweep.errors import DataRefused
from rover_sweep.files.printable import printable

Array = NDArray[np.float64]

STEERING, THROTTLE, THRUST_LEFT, THRUST_RIGHT = 26, 70, 73, 74  # SERVOn_FUNCTION (ArduRover 4.6 parameters)
FAR, FAR_STEPS = 0.1, 10.0  # s, and sampling intervals, from the neighbouring stamps: the stamp is damaged
DISORDER = 1.0  # s that a stamp may be early or late among its neighbours, as over a radio link
ODD = 2  # stamps that may be so in any log: a stream that pauses at its beginning or end
DISORDER_LIMIT = 0.01  # share of stamps beyond that which no recording of one drive has
DUPLICATES_TOLD = 0.005  # share of samples with a repeated or damaged stamp that is worth telling
GYRO_FACTORY_HZ, ACCEL_FACTORY_HZ = 4.0, 10.0  # INS_GYRO_FILTER, INS_ACCEL_FILTER of Rover as delivered


@dataclass(frozen=True, eq=False)
class AppletRows:
    """The applet's SWEP messages: t (n,) s, run (n,), state (n,), clock T of the override (n,) s."""

    t: Array
    run: Array
    state: Array
    clock: Array


@dataclass(frozen=True, eq=False)
class Log:
    """Everything of interest in one log, on the vehicle's clock.

    signals: as the channels of `Recording`, over the whole log and without steering.
    steering: the recorded steering outputs ("pwm" in us, or "delta" in rad from a CSV), best first.
    loops: starts of the autopilot's main loops (n,) s, None where they were not logged.
    arrivals: vehicle's time (n,) s and recorder's time (n,) s of telemetry messages, None of other logs.
    marks: (time [s], text as logged) of messages to the user. parameters: the last value of each.
    limits: (lowest, highest) steering output [us], None where unknown.
    whole: all driving is one run, however it was steered.
    system: MAVLink system id of a telemetry log, 0 where not known.
    vehicle: "rover", another ArduPilot vehicle's name, or "" where the log does not tell.
    """

    name: str
    signals: Mapping[str, Signal]
    steering: tuple[Signal, ...]
    applet: AppletRows | None = None
    loops: Array | None = None
    arrivals: tuple[Array, Array] | None = None
    marks: tuple[tuple[float, str], ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    filters: Mapping[str, LowPass] = field(default_factory=dict)
    limits: tuple[float, float] | None = None
    vehicle: str = ""
    firmware: str = ""
    notes: tuple[Note, ...] = ()
    sources: tuple[tuple[str, str], ...] = ()
    whole: bool = False
    system: int = 0


def source_of(path: Path) -> tuple[str, str]:
    """(path name, sha256) of a file, for `Recording.sources`."""
    with path.open("rb") as file:
        return path.name, hashlib.file_digest(file, "sha256").hexdigest()


def vehicle_of(firmware: str) -> str:
    """The kind of vehicle that a firmware's banner names, "" where it names none."""
    banner = firmware.lower()
    kinds = {
        "rover": "rover",
        "copter": "copter",
        "plane": "plane",
        "sub": "submarine",
        "tracker": "antenna tracker",
        "blimp": "blimp",
        "heli": "helicopter",
    }
    return next((kind for word, kind in kinds.items() if word in banner), "")


def firmware_of(marks: Iterable[tuple[float, str]]) -> str:
    """The banner among messages to the user, printable, as "ArduRover V4.6.3 (3fc7011a)"; "" for none."""
    return printable(next((text for _, text in marks if is_banner(text)), ""))


def is_banner(text: str) -> bool:
    """Whether a message to the user is the firmware's banner."""
    return text.startswith(("Ardu", "APM:", "AntennaTracker", "Blimp")) and " v" in text.lower()


def finite_only(named: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Parameters by name, the last of each, without those whose value is no number: as if not recorded."""
    return {name: value for name, value in named if math.isfinite(value)}


def output_channel(parameters: Mapping[str, float], function: int) -> int | None:
    """Servo output (1-based) that carries a SERVOn_FUNCTION; firmware before 3.2 has RCMAP_* instead."""
    for n in range(1, 33):
        if round(parameters.get(f"SERVO{n}_FUNCTION", -1)) == function:
            return n
    if any(name.startswith("SERVO") and name.endswith("_FUNCTION") for name in parameters):
        return None
    old = {STEERING: "RCMAP_ROLL", THROTTLE: "RCMAP_THROTTLE"}.get(function, "")
    return round(parameters[old]) if old in parameters else None


def output_limits(parameters: Mapping[str, float], channel: int) -> tuple[float, float] | None:
    """SERVOn_MIN and SERVOn_MAX [us] of an output (RCn_* before 3.2), None where not recorded."""
    for prefix in (f"SERVO{channel}", f"RC{channel}"):
        if f"{prefix}_MIN" in parameters and f"{prefix}_MAX" in parameters:
            return float(parameters[f"{prefix}_MIN"]), float(parameters[f"{prefix}_MAX"])
    return None


def sensor_filters(
    parameters: Mapping[str, float], override: Mapping[str, float] | None, raw: frozenset[str] = frozenset()
) -> tuple[dict[str, LowPass], tuple[Note, ...]]:
    """The low-pass of r, p (gyro) and ay (accelerometer), and what must be said about it.

    override: {"gyro_hz", "accel_hz"} [Hz] instead of the recorded parameters. A cut-off of 0 means off.
    raw: channels that come from unfiltered samples. Where nothing is known the factory values are assumed.
    """
    filters: dict[str, LowPass] = {}
    notes: list[Note] = []
    told = override or {}
    for key, name, factory, channels in (
        ("gyro_hz", "INS_GYRO_FILTER", GYRO_FACTORY_HZ, ("r", "p")),
        ("accel_hz", "INS_ACCEL_FILTER", ACCEL_FACTORY_HZ, ("ay",)),
    ):
        filtered = [c for c in channels if c not in raw]
        cutoff, source = told.get(key, parameters.get(name)), name
        if key in told:
            source = f"given as {key}"
        elif cutoff is None and filtered:
            cutoff, source = factory, ASSUMED
            notes.append(
                Note(
                    "warning",
                    f"The log does not hold {name}: the factory value {factory:g} Hz is assumed; "
                    f"give {key} if it was set otherwise",
                )
            )
        if cutoff:
            filters |= {c: LowPass(float(cutoff), source) for c in filtered}
    return filters, tuple(notes)


def increasing(t: Array, *columns: Array) -> tuple[Array, tuple[Array, ...]]:
    """Samples with a plausible stamp that is later than all before.

    A single damaged stamp in the future must not void what follows, so a stamp that lies far from the
    median of its neighbourhood is dropped first; where time only increases that is the stamp itself.
    """
    finite = np.isfinite(t)
    t, columns = t[finite], tuple(c[finite] for c in columns)
    if t.size > 5:
        near = _off(t) <= max(FAR, FAR_STEPS * float(np.median(np.abs(np.diff(t)))))
        t, columns = t[near], tuple(c[near] for c in columns)
    keep = np.ones(t.size, bool)
    keep[1:] = t[1:] > np.maximum.accumulate(t)[:-1]
    return t[keep], tuple(c[keep] for c in columns)


def _off(t: Array) -> Array:
    """How far (n,) s each stamp lies from the median of its neighbourhood of five."""
    padded = np.pad(t, 2, mode="reflect")
    return np.abs(t - np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1))


def refuse_disorder(name: str, stamps: Mapping[str, Array]) -> None:
    """Raise DataRefused where stamps {message: (n,) s} are out of order by much, and often."""
    for message, all_stamps in stamps.items():
        t = all_stamps[np.isfinite(all_stamps)]
        if t.size <= 5:
            continue
        lone = _off(t) > DISORDER
        rest = t[~lone]
        behind = np.maximum.accumulate(rest) - rest if rest.size else rest
        count = int(lone.sum() + np.sum(behind > DISORDER))
        if count > max(ODD, DISORDER_LIMIT * t.size):
            raise DataRefused(
                f"{name}: {count} of {t.size} times of {message} are out of order, by up to "
                f"{float(np.max(behind, initial=0.0)):.3g} s: damaged, or several drives in one file "
                "(part them; in a .csv name their column as trial)"
            )


def clock_notes(stamps: Mapping[str, Array]) -> Iterator[Note]:
    """What `increasing` leaves out of the messages with these stamps {message: (n,) s}."""
    for name, t in stamps.items():
        backwards = int(np.sum(np.diff(t) < 0))
        if backwards:
            yield Note(
                "warning",
                f"The clock of {name} runs back {backwards} times; "
                "samples that are not later than the one before were left out",
            )
        lost = t.size - increasing(t)[0].size
        if lost > DUPLICATES_TOLD * t.size:
            text = f"{lost} of {t.size} samples of {name} have the time of another and were left out"
            yield Note("info", text)


def body_velocity(t: Array, vn: Array, ve: Array, psi: Array, source: str) -> dict[str, Signal]:
    """speed (forward) and vy (left) [m/s] from velocity north and east [m/s] and heading psi [rad]."""
    speed = vn * np.cos(psi) - ve * np.sin(psi)
    left = -vn * np.sin(psi) - ve * np.cos(psi)
    return {"speed": Signal(t, speed, "m/s", source), "vy": Signal(t, left, "m/s", source)}


def joined_steering(fine: Signal, coarse: Signal | None) -> Signal:
    """A staircase that is `fine` where that was logged, and `coarse` before, after and in its long gaps."""
    if coarse is None or fine.t.size == 0:
        return fine
    step = 1.0  # s: outside a run the applet may be silent
    k = np.searchsorted(fine.t, coarse.t, "right")
    before = np.where(k > 0, coarse.t - fine.t[np.maximum(k - 1, 0)], np.inf)
    after = np.where(k < fine.t.size, fine.t[np.minimum(k, fine.t.size - 1)] - coarse.t, np.inf)
    # behind the last sample of a run the first coarse sample takes over at once
    lone = (before > 0) & (after > 0) & ((before + after) > step)
    t, x = np.concatenate((fine.t, coarse.t[lone])), np.concatenate((fine.x, coarse.x[lone]))
    order = np.argsort(t, kind="stable")
    return Signal(t[order], x[order], fine.unit, fine.source, hold=fine.hold)
