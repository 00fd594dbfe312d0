"""A complete log in SI units and ISO axes, before its runs are found."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import ASSUMED, Array, LowPass, Note, Signal
from rover_sweep.errors import DataRefused
from rover_sweep.files.documents import printable

STEERING, THROTTLE, THRUST_LEFT, THRUST_RIGHT = 26, 70, 73, 74  # SERVOn_FUNCTION (ArduRover 4.6 parameters)
APPLET_LIMITS = ("SWP_PWM_MAX", "SWP_R_MAX", "SWP_P_MAX")
FAR, FAR_STEPS = 0.1, 10.0  # s, and sampling intervals; a stamp this far from its neighbours is damaged
DISORDER = 1.0  # s, largest normal disorder of a stamp, as over a radio link
ODD = 2  # disordered stamps allowed in any log: a stream that pauses at its start or end
DISORDER_LIMIT = 0.01  # share of disordered stamps; one drive has fewer
DUPLICATES_REPORTED = 0.005  # share of samples with a repeated or damaged stamp that gets a note
DIFFERENT = 0.7  # rms difference over standard deviation; two drives of one wave give about 1.4
LEAST_US = 10.0  # rms; smaller differences are ignored
LOOP = 0.02  # s, the slowest main loop; a command may wait so long before it is on the servo
GYRO_FACTORY_HZ, ACCEL_FACTORY_HZ = 4.0, 10.0  # INS_GYRO_FILTER, default INS_ACCEL_FILTER of Rover


@dataclass(frozen=True, eq=False)
class AppletRows:
    """The applet's SWEP or SWET messages: t (n,) s, run (n,), state (n,), clock T of the override (n,) s."""

    t: Array
    run: Array
    state: Array
    clock: Array

    def where(self, keep: NDArray[np.bool_] | slice) -> AppletRows:
        """The rows of a mask (n,) or a slice."""
        return AppletRows(self.t[keep], self.run[keep], self.state[keep], self.clock[keep])


@dataclass(frozen=True)
class Contradiction:
    """A channel that others contradict. channel: "speed", "heading", "r", ..

    decided: the others say what it should be, and it was corrected. speed_sd: sd of the logarithm of the
    speed's scale, as it is now. turned: the direction of driving or turning is in doubt.
    """

    channel: str
    decided: bool
    text: str
    speed_sd: float = 0.0
    turned: bool = False


@dataclass(frozen=True, eq=False)
class Log:
    """The contents of one log, on the vehicle's clock.

    signals: channels as in `Recording`, without steering, over the whole log.
    steering: the recorded steering outputs ("pwm" in us, or "delta" in rad from a CSV), best first.
    loops: starts (n,) [s] of the autopilot's main loops, None if not logged.
    arrivals: vehicle's time (n,) [s] and recorder's time (n,) [s] of telemetry messages, None in other logs.
    marks: (time [s], text as logged) of messages to the user. parameters: last value of each.
    applet, throttle_applet: the applet's runs on the steering and on the throttle, None without one.
    limits: (lowest, highest) steering output [us], None where unknown.
    whole: all driving is one run, independent of the steering.
    system: MAVLink system id of a telemetry log, 0 if not known.
    unsure: of a file of another system: "r" or "speed", whose unit is a guess; "delta", which is no angle;
    "course", where the yaw rate is that of the course over ground.
    witnesses: what was recorded again by other means, only to compare: gps_speed, wheel_speed, path_speed
    (of positions) [m/s], gps_course [rad, left positive], r2 [rad/s] of a second IMU.
    contradictions: between channels, and what became of them (`logs.cross_check`).
    vehicle: "rover", another ArduPilot vehicle's name, or "" if not known.
    """

    name: str
    signals: Mapping[str, Signal]
    steering: tuple[Signal, ...]
    applet: AppletRows | None = None
    throttle_applet: AppletRows | None = None
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
    unsure: tuple[str, ...] = ()
    witnesses: Mapping[str, Signal] = field(default_factory=dict)
    contradictions: tuple[Contradiction, ...] = ()


def source_of(path: Path) -> tuple[str, str]:
    """(path name, sha256) of a file, for `Recording.sources`."""
    with path.open("rb") as file:
        return path.name, hashlib.file_digest(file, "sha256").hexdigest()


def vehicle_of(firmware: str) -> str:
    """The kind of vehicle in a firmware's banner, "" for none."""
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
    """The banner among the messages to the user, such as "ArduRover V4.6.3 (3fc7011a)"; "" for none."""
    begins = ("Ardu", "APM:", "AntennaTracker", "Blimp")
    banners = (text for _, text in marks if text.startswith(begins) and " v" in text.lower())
    return printable(next(banners, ""))


def finite_only(named: Iterable[tuple[str, float]]) -> dict[str, float]:
    """{parameter: last value}, without values that are not finite."""
    return {name: value for name, value in named if math.isfinite(value)}


def output_channel(parameters: Mapping[str, float], function: int) -> int | None:
    """First servo output (1-based) with a SERVOn_FUNCTION, None if unknown; before 3.2 from RCMAP_*."""
    if outputs := output_channels(parameters, function):
        return outputs[0]
    if any(name.startswith("SERVO") and name.endswith("_FUNCTION") for name in parameters):
        return None
    old = {STEERING: "RCMAP_ROLL", THROTTLE: "RCMAP_THROTTLE"}.get(function, "")
    return round(parameters[old]) if old in parameters else None


def output_channels(parameters: Mapping[str, float], function: int) -> tuple[int, ...]:
    """All servo outputs (1-based) with a SERVOn_FUNCTION."""
    return tuple(n for n in range(1, 33) if round(parameters.get(f"SERVO{n}_FUNCTION", -1)) == function)


def output_limits(parameters: Mapping[str, float], channel: int) -> tuple[float, float] | None:
    """SERVOn_MIN and SERVOn_MAX [us] of an output (RCn_* before 3.2), None if not recorded."""
    for prefix in (f"SERVO{channel}", f"RC{channel}"):
        if f"{prefix}_MIN" in parameters and f"{prefix}_MAX" in parameters:
            return float(parameters[f"{prefix}_MIN"]), float(parameters[f"{prefix}_MAX"])
    return None


def limits_of_steering(parameters: Mapping[str, float]) -> dict[str, float]:
    """{parameter: value} that bound the steering: SERVOn_MIN, _MAX, _TRIM and the applet's limits."""
    channel = output_channel(parameters, STEERING) or 1
    found = {name: parameters[name] for name in APPLET_LIMITS if name in parameters}
    if (ends := output_limits(parameters, channel)) is not None:
        found |= {f"SERVO{channel}_MIN": ends[0], f"SERVO{channel}_MAX": ends[1]}
        trim = parameters.get(f"SERVO{channel}_TRIM")
        found |= {} if trim is None else {f"SERVO{channel}_TRIM": trim}
    return found


def sensor_filters(
    parameters: Mapping[str, float], override: Mapping[str, float] | None, raw: frozenset[str] = frozenset()
) -> tuple[dict[str, LowPass], tuple[Note, ...]]:
    """({channel: low-pass} of r, p (gyro) and ay (accelerometer), notes).

    override: {"gyro_hz", "accel_hz"} [Hz] that replace the recorded parameters; a cut-off of 0 means off.
    raw: channels from unfiltered samples. Without any information the default values are assumed.
    """
    filters: dict[str, LowPass] = {}
    notes: list[Note] = []
    given = override or {}
    for key, name, factory, channels in (
        ("gyro_hz", "INS_GYRO_FILTER", GYRO_FACTORY_HZ, ("r", "p")),
        ("accel_hz", "INS_ACCEL_FILTER", ACCEL_FACTORY_HZ, ("ay",)),
    ):
        filtered = [c for c in channels if c not in raw]
        cutoff, source = given.get(key, parameters.get(name)), name
        if key in given:
            source = f"given as {key}"
        elif cutoff is None and filtered:
            cutoff, source = factory, ASSUMED
            notes.append(
                Note(
                    "warning",
                    f"The log does not hold {name}: models assume the default {factory:g} Hz{_allowed(key)}; "
                    f"give {key} if it was set to another value",
                )
            )
        if cutoff:
            filters |= {c: LowPass(float(cutoff), source) for c in filtered}
    return filters, tuple(notes)


def _allowed(key: str) -> str:
    return ", and the numbers of any driving allow for no filter too" if key == "gyro_hz" else ""


def increasing(t: Array, *columns: Array) -> tuple[Array, tuple[Array, ...]]:
    """The samples (t (n,), columns (n,)) whose time stamp is plausible and later than all before.

    Stamps far from the median of their neighbours are removed first, as one damaged stamp in the future would
    otherwise remove all samples after it.
    """
    finite = np.isfinite(t)
    t, columns = t[finite], tuple(c[finite] for c in columns)
    if t.size > 5:
        near = _distance_from_median(t) <= max(FAR, FAR_STEPS * float(np.median(np.abs(np.diff(t)))))
        t, columns = t[near], tuple(c[near] for c in columns)
    keep = np.ones(t.size, bool)
    keep[1:] = t[1:] > np.maximum.accumulate(t)[:-1]
    return t[keep], tuple(c[keep] for c in columns)


def _distance_from_median(t: Array) -> Array:
    """Distance (n,) [s] of each stamp from the median of five stamps around it."""
    padded = np.pad(t, 2, mode="reflect")
    return np.abs(t - np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1))


def refuse_disorder(name: str, stamps: Mapping[str, Array]) -> None:
    """Raise DataRefused when many stamps {message: (n,) s} are out of order by more than 1 s."""
    for message, t in stamps.items():
        if words := disorder(message, t):
            raise DataRefused(f"{name}: {words}")


def disorder(message: str, stamps: Array) -> str:
    """Advice on stamps (n,) [s] of which many are out of order by more than 1 s, else ""."""
    rows = np.flatnonzero(np.isfinite(stamps))
    t = stamps[rows]
    if t.size <= 5:
        return ""
    lone = _distance_from_median(t) > DISORDER
    rest, rows = t[~lone], rows[~lone]
    behind = np.maximum.accumulate(rest) - rest if rest.size else rest
    count = int(lone.sum() + np.sum(behind > DISORDER))
    if count <= max(ODD, DISORDER_LIMIT * t.size):
        return ""
    place = ""
    if np.any(late := behind > DISORDER):
        k = int(np.argmax(late))
        place = f", first in row {rows[k] + 1}, from {rest[k - 1] - t[0]:.2f} to {rest[k] - t[0]:.2f} s"
    return (
        f"{count} of {t.size} times of {message} are out of order, by up to "
        f"{float(np.max(behind, initial=0.0)):.3g} s{place}: the log is damaged, or holds several "
        "drives (split it; in a .csv name their column as trial)"
    )


def clock_notes(stamps: Mapping[str, Array]) -> Iterator[Note]:
    """Notes on the samples that `increasing` removes, from stamps {message: (n,) s}."""
    for name, t in stamps.items():
        backwards = int(np.sum(np.diff(t) < 0))
        if backwards:
            yield Note(
                "warning",
                f"The clock of {name} runs back {backwards} times; "
                "samples that are not later than the previous one were left out",
            )
        lost = t.size - increasing(t)[0].size
        if lost > DUPLICATES_REPORTED * t.size:
            text = f"{lost} of {t.size} samples of {name} have the time of another sample and were left out"
            yield Note("info", text)


def message_signals(
    name: str, t: Array, channels: Mapping[str, tuple[str, float, str]], column: Callable[[str], NDArray[Any]]
) -> dict[str, Signal]:
    """Channels of one message type with stamps t (n,) [s]. channels: {channel: (column, factor, unit)}.

    column: gives the values (n,) of a column by its name.
    """
    t, columns = increasing(t, *(np.asarray(column(c), float) * factor for c, factor, _ in channels.values()))
    found = {
        channel: Signal(t, x, unit, f"{name}.{c}")
        for (channel, (c, _, unit)), x in zip(channels.items(), columns, strict=True)
    }
    if "psi" in found:
        found["psi"] = replace(found["psi"], x=np.unwrap(found["psi"].x))
    return found


def finite_signal(signal: Signal) -> Signal:
    """The signal without samples that are not finite."""
    keep = np.isfinite(signal.x)
    return signal if keep.all() else replace(signal, t=signal.t[keep], x=signal.x[keep])


def body_velocity(t: Array, vn: Array, ve: Array, psi: Array, source: str) -> dict[str, Signal]:
    """speed (forward) and vy (left) [m/s] from velocity north and east [m/s] and heading psi [rad]."""
    speed = vn * np.cos(psi) - ve * np.sin(psi)
    left = -vn * np.sin(psi) - ve * np.cos(psi)
    return {"speed": Signal(t, speed, "m/s", source), "vy": Signal(t, left, "m/s", source)}


def joined_steering(fine: Signal, coarse: Signal | None) -> Signal:
    """A staircase: `fine`, and `coarse` in gaps of `fine` longer than the interval of `coarse`.

    An applet that pauses logs nothing while the servo may return to trim, so its last value must not be held.
    A coarse value holds from halfway after the sample before it: the output changed somewhere between them.
    A `coarse` that is another output is not used.
    """
    if coarse is None or fine.t.size == 0 or coarse.t.size < 2 or are_different(*disagreement(coarse, fine)):
        return fine
    interval = float(np.median(np.diff(coarse.t)))
    k = np.searchsorted(fine.t, coarse.t, "right")
    before = np.where(k > 0, coarse.t - fine.t[np.maximum(k - 1, 0)], np.inf)
    after = np.where(k < fine.t.size, fine.t[np.minimum(k, fine.t.size - 1)] - coarse.t, np.inf)
    lone = (before > LOOP) & (after > 0) & (before + after > interval)
    since = np.minimum(before, np.append(interval, np.diff(coarse.t)))
    edges = coarse.t - 0.5 * np.minimum(since, interval)
    t, x = np.concatenate((fine.t, edges[lone])), np.concatenate((fine.x, coarse.x[lone]))
    order = np.argsort(t, kind="stable")
    return replace(fine, t=t[order], x=x[order])


def disagreement(coarse: Signal, fine: Signal) -> tuple[float, float]:
    """(rms difference, standard deviation of `coarse`) [us] where both were logged, else zeros."""
    k = np.searchsorted(fine.t, coarse.t)
    inside = (k > 0) & (k < fine.t.size)
    steps = np.diff(fine.t)
    inside[inside] = steps[k[inside] - 1] <= max(1.0, 3 * float(np.median(steps))) if steps.size else False
    if not np.any(inside):
        return 0.0, 0.0
    difference = coarse.x[inside] - np.interp(coarse.t[inside], fine.t, fine.x)
    return float(np.sqrt(np.mean(difference**2))), float(np.std(coarse.x[inside]))


def are_different(difference: float, spread: float) -> bool:
    """True when a `disagreement` shows that two recorded outputs are not the same one."""
    return difference > max(LEAST_US, DIFFERENT * spread)
