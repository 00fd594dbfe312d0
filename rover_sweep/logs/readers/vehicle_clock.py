"""The vehicle's time for every message of a telemetry log, independent of the times of arrival."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import AT_LOOP, Array, Note, Signal
from rover_sweep.errors import DataRefused
from rover_sweep.logs.log import (
    AppletRows,
    Log,
    are_different,
    disagreement,
    finite_only,
    increasing,
    sensor_filters,
)
from rover_sweep.logs.readers.dataflash import DataFlash, open_parts
from rover_sweep.logs.readers.tlog import Frames

CLOCKS = (
    "ATTITUDE",
    "RAW_IMU",
    "SCALED_IMU",
    "SCALED_IMU2",
    "HIGHRES_IMU",
    "LOCAL_POSITION_NED",
    "GLOBAL_POSITION_INT",
)
WRAP = 2.0**32 * 1e-6  # s after which SERVO_OUTPUT_RAW.time_usec starts again
REBOOT = 1.0  # s; a clock that falls by more has restarted
CONFIRMING = 5  # messages that must confirm a restart
REPEATED = 1 << 18  # bytes of a .tlog, within which an identical frame is a repetition


@dataclass(frozen=True, eq=False)
class BootMessages:
    """The vehicle's messages between two restarts, with a clock for messages without time.

    clock (n,) [s] at positions clock_order (n,) [bytes] of the file.
    """

    messages: Mapping[str, Frames]
    clock_order: NDArray[np.int64]
    clock: Array

    def seconds(self, name: str) -> Array:
        """Vehicle time (n,) [s] of each message of a name; without a time, that of the previous message."""
        frames = self.messages[name]
        if "time_boot_ms" in frames.fields:
            return frames.rows["time_boot_ms"].astype(float) * 1e-3
        k = np.clip(np.searchsorted(self.clock_order, frames.order, "right") - 1, 0, None)
        before = self.clock[k]
        if "time_usec" not in frames.fields:
            return before
        t = frames.rows["time_usec"].astype(float) * 1e-6
        return t + WRAP * np.round((before - t) / WRAP) if frames.rows["time_usec"].itemsize == 4 else t

    def texts(self) -> list[tuple[float, str]]:
        """(time [s], text as sent) of the messages to the user."""
        if "STATUSTEXT" not in self.messages:
            return []
        sent = self.messages["STATUSTEXT"].rows["text"].tolist()
        texts = (text.decode("utf-8", "replace") for text in sent)
        return list(zip(self.seconds("STATUSTEXT").tolist(), texts, strict=True))

    def parameters(self, until: float = np.inf) -> dict[str, float]:
        """{parameter: last value heard up to a time [s]}."""
        if "PARAM_VALUE" not in self.messages:
            return {}
        rows = self.messages["PARAM_VALUE"].rows[self.seconds("PARAM_VALUE") <= until]
        names = (name.decode("ascii", "replace") for name in rows["param_id"].tolist())
        return finite_only(zip(names, rows["param_value"].astype(float).tolist(), strict=True))


def sessions(messages: Mapping[str, Frames]) -> Iterator[BootMessages]:
    """The vehicle's messages, split where its clock restarts; empty if no message has a time.

    Repeated frames are removed, and frames that arrived in a wrong order are sorted.
    """
    single = {name: _without_repeats(frames) for name, frames in messages.items()}
    clocks = [single[n] for n in CLOCKS if n in single]
    if not clocks:
        return
    order = np.concatenate([f.order for f in clocks])
    own = [("time_boot_ms", 1e-3) if "time_boot_ms" in f.fields else ("time_usec", 1e-6) for f in clocks]
    times = np.concatenate([f.rows[n].astype(float) * unit for f, (n, unit) in zip(clocks, own, strict=True)])
    sorting = np.argsort(order)
    order, times = order[sorting], times[sorting]
    edges = [-1, *order[_restarts(times)].tolist(), int(np.iinfo(np.int64).max)]
    for start, end in zip(edges[:-1], edges[1:], strict=True):
        inside = (order >= start) & (order < end)
        parts = {n: f.where((f.order >= start) & (f.order < end)) for n, f in single.items()}
        clock = np.maximum.accumulate(times[inside])  # a late message does not move it back
        session = BootMessages({n: f for n, f in parts.items() if len(f)}, order[inside], clock)
        late = {n: np.argsort(session.seconds(n), kind="stable") for n in session.messages}
        yield replace(session, messages={n: session.messages[n].where(k) for n, k in late.items()})


def _restarts(times: Array) -> NDArray[np.int64]:
    """Indices (k,) at which stamps (n,) [s] fall by more than `REBOOT` and stay low.

    A message that the link delayed is low alone, among newer ones.
    """
    falls = np.flatnonzero(np.diff(times) < -REBOOT) + 1
    stays = [k for k in falls if np.max(times[k : k + CONFIRMING]) < times[k - 1] - REBOOT]
    return np.array(stays, np.int64)


def _without_repeats(frames: Frames) -> Frames:
    """Without frames that repeat an earlier one in content and sequence number, as links do."""
    heads = np.stack((frames.system, frames.component, frames.sequence), axis=1)
    bodies = np.ascontiguousarray(frames.rows).view(np.uint8).reshape(len(frames), -1)
    whole = np.concatenate((heads, bodies), axis=1)
    keys: list[bytes] = whole.view(f"V{whole.shape[1]}")[:, 0].tolist()
    if len(set(keys)) == len(keys):
        return frames
    seen: dict[bytes, int] = {}
    keep = np.ones(len(frames), bool)
    for k, (key, at) in enumerate(zip(keys, frames.order.tolist(), strict=True)):
        keep[k] = at - seen.get(key, -REPEATED) >= REPEATED
        seen[key] = at
    return frames.where(keep)


# Merges a DataFlash log and the telemetry log of the same drive.


UNCOVERED = 30.0  # s of the log without telemetry; more gives a warning


def paired(flash: Log, telemetry: tuple[Log, ...]) -> Log:
    """The DataFlash log with the steering, and missing channels, of the telemetry log.

    Both have the vehicle's time since boot, so no alignment is needed; the steering outputs show whether they
    are of one drive. DataRefused when they are not.
    """
    match = max(telemetry, key=lambda log: overlap(flash, log))
    (a, b), (c, d) = extent(flash), extent(match)
    if overlap(flash, match) < 1.0:
        raise DataRefused(
            f"{flash.name} ({a:.0f} to {b:.0f} s after boot) and {match.name} ({c:.0f} to {d:.0f} s after "
            "boot) have no vehicle time in common: give the two logs of one drive"
        )
    difference = spread = 0.0
    if flash.steering and match.steering:
        difference, spread = disagreement(flash.steering[-1], match.steering[0])
    if are_different(difference, spread):
        raise DataRefused(
            f"{flash.name} and {match.name} are not of one drive: their steering outputs differ by "
            f"{difference:.0f} us (rms) and vary by {spread:.0f} us; give the two logs of one drive"
        )
    filters, _ = sensor_filters(flash.parameters, None)
    borrowed = {c: s for c, s in match.signals.items() if c not in flash.signals}
    notes = [Note("info", f"{c} comes from the telemetry log") for c in borrowed]
    uncovered = c > a + UNCOVERED or d < b - UNCOVERED
    if flash.applet is None and match.steering and uncovered:  # runs may be missed
        text = (
            f"The telemetry log covers {c:.0f} to {d:.0f} s of the log's {a:.0f} to {b:.0f} s: "
            "runs outside are left out"
        )
        notes.append(Note("warning", text))
    # best first: the applet's staircase, then the others by sampling rate
    steering = sorted((*flash.steering, *match.steering), key=lambda s: -s.rate)
    staircase = [s for s in flash.steering if s.hold]
    return Log(
        name=flash.name,
        signals={**flash.signals, **borrowed},
        steering=(*staircase, *(s for s in steering if s not in staircase)),
        applet=flash.applet,
        loops=flash.loops,
        marks=flash.marks or match.marks,
        parameters={**match.parameters, **flash.parameters},
        filters={**{c: f for c, f in filters.items() if c in borrowed}, **flash.filters},
        limits=flash.limits or match.limits,
        vehicle=flash.vehicle or match.vehicle,
        firmware=flash.firmware or match.firmware,
        notes=(*flash.notes, *notes),
        sources=flash.sources + match.sources,
        witnesses={**match.witnesses, **flash.witnesses},
    )


def overlap(one: Log, other: Log) -> float:
    """Vehicle time [s] that both logs cover."""
    (a, b), (c, d) = extent(one), extent(other)
    return min(b, d) - max(a, c)


def extent(log: Log) -> tuple[float, float]:
    """First and last vehicle time [s] of any signal."""
    signals = [s for s in (*log.signals.values(), *log.steering) if s.t.size]
    return min((float(s.t[0]) for s in signals), default=0.0), max(
        (float(s.t[-1]) for s in signals), default=0.0
    )


# Time-stamps commands at the main loop that applied them.


MOST_DROPPED = 10  # consecutive loops without their message; more are a hole
SAME_RATE = 0.05  # relative tolerance of the rate of the stamps around SCHED_LOOP_RATE


def main_loops(stamps: Array, parameters: Mapping[str, float]) -> Array | None:
    """Starts (n,) [s] of the main loops, from the stamps of a message that each loop logs.

    None when the message was logged at another rate than SCHED_LOOP_RATE. IMU is written by `ahrs_update`,
    before `set_servos` in the same loop (source: the scheduler table of Rover-4.6.3, Rover.cpp). Loops whose
    message was dropped are interpolated.
    """
    rate = parameters.get("SCHED_LOOP_RATE", 0.0)
    if stamps.size < 2 or rate <= 0 or abs(float(np.median(np.diff(stamps))) * rate - 1.0) > SAME_RATE:
        return None
    steps = np.diff(stamps)
    count = np.rint(steps * rate).astype(int)
    count[(count < 1) | (count > MOST_DROPPED)] = 1
    first = np.repeat(np.cumsum(count) - count, count)
    within = (np.arange(first.size) - first) / np.repeat(count, count)
    return np.append(np.repeat(stamps[:-1], count) + within * np.repeat(steps, count), stamps[-1])


def at_main_loops(steering: Signal, loops: Array | None) -> Signal:
    """A staircase of commands (pwm, us) with each edge moved to the next main loop, which applies it.

    The outputs are sent once per main loop (source: AP_MotorsUGV::output), so a script's command waits up to
    one period. Of several commands between two loops only the last is sent. Unchanged when the loops are
    unknown (None); half a period later where no loop was logged for long.
    """
    if loops is None or not steering.hold or steering.t.size == 0:
        return steering
    period = float(np.median(np.diff(loops)))
    k = np.minimum(np.searchsorted(loops, steering.t, "left"), loops.size - 1)
    near = (loops[k] >= steering.t) & (loops[k] - steering.t <= 1.5 * period)
    t = np.where(near, loops[k], steering.t + 0.5 * period)
    last = np.append(np.diff(t) > 0, True)
    return replace(steering, t=t[last], x=steering.x[last], source=f"{steering.source} {AT_LOOP}")


# The number of messages that the autopilot could not write to a log.


def dropped_messages(path: Path) -> int | None:
    """From DSF.Dp, which counts from boot (AP_Logger_File); None for a log without it."""
    dropped = [np.ptp(part.rows("DSF", "Dp")["Dp"]) for part in open_parts(path) if part.has("DSF", "Dp")]
    return int(sum(dropped)) if dropped else None


# The applet's own messages in a DataFlash log: SWEP of a steering run, SWET of a throttle sweep.


def applet_rows(flash: DataFlash, message: str) -> AppletRows | None:
    """Number and state of the runs; None without that message."""
    if not flash.has(message, "Run", "St", "T"):
        return None
    rows = flash.rows(message)
    t, (run, state, clock) = increasing(
        flash.seconds(message, rows), *(flash.column(message, c, rows) for c in ("Run", "St", "T"))
    )
    return AppletRows(t, run, state, clock)


def applet_output(flash: DataFlash, message: str) -> Signal | None:
    """The applet's output [us] as a staircase: Out as read back, or Cmd if Out is not the servo output.

    Out is read immediately after it is set, and reaches the servo at the next main loop.
    """
    if not flash.has(message, "Cmd", "Out"):
        return None
    rows = flash.rows(message)
    t, (wanted, out) = increasing(
        flash.seconds(message, rows), flash.column(message, "Cmd", rows), flash.column(message, "Out", rows)
    )
    is_output = np.ptp(out) > 0 and float(np.min(out)) > 0
    name = f"{message}.Out" if is_output else f"{message}.Cmd"
    return Signal(t, out if is_output else wanted, "us", name, hold=True, origin="commanded")
