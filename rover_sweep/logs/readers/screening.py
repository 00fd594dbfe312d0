"""Removes impossible samples and constant channels of a log with a note, or refuses the log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import MOTIONS, Note, Recording, Signal
from rover_sweep.errors import DataRefused
from rover_sweep.logs.log import Log

# (lowest, highest) possible value in the channel's unit: full scale of all sensors in use (gyro 34.9 rad/s,
# accelerometer 16 or 30 g), servo pulses, rovers on wheels.
POSSIBLE: Mapping[str, tuple[float, float]] = {
    "r": (-40.0, 40.0),
    "p": (-40.0, 40.0),
    "ay": (-400.0, 400.0),
    "vy": (-100.0, 100.0),
    "speed": (-100.0, 100.0),
    "phi": (-2 * np.pi, 2 * np.pi),
    "psi": (-np.inf, np.inf),
    "throttle": (500.0, 2500.0),
    "servo": (500.0, 2500.0),
    "pwm": (500.0, 2500.0),
    "delta": (-np.pi / 2, np.pi / 2),
}
STEERING_WHEEL = 6 * np.pi  # rad, three turns to one side
OUTPUTS = ("pwm", "throttle")  # 0 us is an output that is switched off
OTHER_UNIT = {
    **dict.fromkeys(("r", "p"), "deg/s"),
    **dict.fromkeys(("delta", "phi"), "deg"),
}  # in which these channels are often written
IMPOSSIBLE_LIMIT = 0.01  # share of a channel's samples; above it the others are unreliable too
MISSING_LIMIT = 0.5  # share that is not finite, and so was not written at all; the others are as good as ever
FEWEST = 20  # samples of a channel in a run


def screened(log: Log, widest: float = POSSIBLE["delta"][1]) -> Log:
    """The log without samples that are not finite or impossible, with notes on them.

    widest: possible steering angle to either side, rad.
    Channels and steering outputs without samples are removed. DataRefused when more than 1 % of the samples
    of a channel are impossible, or half of them are not finite.
    """
    notes: list[Note] = []
    limits = {**POSSIBLE, "delta": (-widest, widest)}
    signals = {name: _possible(log, name, s, limits[name], notes) for name, s in log.signals.items()}
    channels = ["delta" if s.unit == "rad" else "pwm" for s in log.steering]
    steering = [_possible(log, c, s, limits[c], notes) for c, s in zip(channels, log.steering, strict=True)]
    return replace(
        log,
        signals={name: s for name, s in signals.items() if s.t.size},
        steering=tuple(s for s in steering if s.t.size),
        notes=(*log.notes, *notes),
    )


def _possible(
    log: Log, channel: str, signal: Signal, limits: tuple[float, float], notes: list[Note]
) -> Signal:
    low, high = limits
    off = (signal.x == 0) & (channel in OUTPUTS)
    finite = np.isfinite(signal.x)
    if not finite.all():
        notes.append(_missing(log, channel, signal, finite))
        signal, off = replace(signal, t=signal.t[finite], x=signal.x[finite]), off[finite]
    wrong: NDArray[np.bool_] = ~off & ~((signal.x >= low) & (signal.x <= high))
    count = int(wrong.sum())
    if count == 0 and not off.any():
        return signal
    if count:
        x = signal.x[wrong]
        finding = (
            f"{count} of {signal.x.size} samples of {channel} ({signal.source}) are impossible, "
            f"such as {x[int(np.argmax(np.abs(x)))]:.3g} {signal.unit}"
        )
        if count > 1 + IMPOSSIBLE_LIMIT * signal.x.size:
            raise DataRefused(f"{log.name}: {finding}; {_other_unit(channel, signal)}")
        notes.append(Note("warning", f"{finding}; they were left out"))
    keep = ~(wrong | off)
    return replace(signal, t=signal.t[keep], x=signal.x[keep])


def _missing(log: Log, channel: str, signal: Signal, finite: NDArray[np.bool_]) -> Note:
    """A note on samples that are not finite, with their place; DataRefused for too many."""
    count, at = int((~finite).sum()), signal.t[~finite]
    words = f"{count} of {finite.size} samples of {channel} ({signal.source}) are no finite number"
    if count > 1 + MISSING_LIMIT * finite.size:
        raise DataRefused(f"{log.name}: {words}; the file is damaged: copy the log again")
    return Note("warning", f"{words}, from {at[0]:.1f} to {at[-1]:.1f} s; they were left out")


def _other_unit(channel: str, signal: Signal) -> str:
    """What to do where most values of a channel are impossible."""
    unit = OTHER_UNIT.get(channel)
    if unit is None:
        other = f"or {channel} is in another unit"
        return f"the file is damaged, {other}: copy the log again, or convert the channel"
    column = signal.source.removeprefix("column ")
    return (
        f"are they in {unit}? For a .csv, give the unit in the column map: "
        f'{channel} = {{column = "{column}", unit = "{unit}"}}; else copy the log again'
    )


def without_dead_channels(run: Recording) -> Recording:
    """The run without lateral channels that are constant or have too few samples.

    DataRefused when this is the yaw rate, which every identification needs.
    """
    reasons = {}
    for c in (c for c in MOTIONS if c in run):
        signal = run.manoeuvre(c)
        if signal.t.size < FEWEST:
            reasons[c] = f"has only {signal.t.size} samples in the run"
        elif np.ptp(signal.x) == 0:
            reasons[c] = f"does not change ({signal.x[0] + 0.0:.4g} {signal.unit}): not recorded?"
    if "r" in reasons:
        raise DataRefused(f"{run.name}: r ({run['r'].source}) {reasons['r']}; record the yaw rate")
    if not reasons:
        return run
    left_out = tuple(Note("warning", f"{c} {reason}; it was left out") for c, reason in reasons.items())
    channels = {name: s for name, s in run.channels.items() if name not in reasons}
    return replace(run, channels=channels, notes=(*run.notes, *left_out))
