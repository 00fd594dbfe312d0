"""A DataFlash log and the telemetry log of the same drive as one log."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rover_sweep.data.recording import Note, Signal
from rover_sweep.errors import DataRefused
from rover_sweep.logs.log import Log, sensor_filters

UNLIKE = 0.7  # rms difference over standard deviation; two drives of one wave give about 1.4
UNCOVERED = 30.0  # s of the log without telemetry that are worth a warning
LEAST_US = 10.0  # rms: less tells nothing


def paired(flash: Log, telemetry: tuple[Log, ...]) -> Log:
    """The DataFlash log, with the steering (and whatever it lacks) of the telemetry log.

    Both carry the vehicle's time since boot, so no alignment is fitted; that they belong together is
    checked by the steering output itself. Raises DataRefused where they do not.
    """
    match = max(telemetry, key=lambda log: overlap(flash, log))
    if overlap(flash, match) < 1.0:
        raise DataRefused(
            f"{flash.name} ({_extent(flash)}) and {match.name} ({_extent(match)}) have no vehicle time "
            "in common: give the two logs of one drive"
        )
    apart, spread = _disagreement(flash, match)
    if apart > max(LEAST_US, UNLIKE * spread):
        raise DataRefused(
            f"{flash.name} and {match.name} are not of one drive: their steering outputs differ by "
            f"{apart:.0f} us (rms) where they vary by {spread:.0f}; give the two logs of one drive"
        )
    filters, _ = sensor_filters(flash.parameters, None)
    borrowed = {c: s for c, s in match.signals.items() if c not in flash.signals}
    return Log(
        name=flash.name,
        signals={**flash.signals, **borrowed},
        steering=ranked_steering(flash, match),
        applet=flash.applet,
        loops=flash.loops,
        marks=flash.marks or match.marks,
        parameters={**match.parameters, **flash.parameters},
        filters={**{c: f for c, f in filters.items() if c in borrowed}, **flash.filters},
        limits=flash.limits or match.limits,
        vehicle=flash.vehicle or match.vehicle,
        firmware=flash.firmware or match.firmware,
        notes=(
            *flash.notes,
            *(Note("info", f"{c} comes from the telemetry log") for c in borrowed),
            *_coverage(flash, match),
        ),
        sources=flash.sources + match.sources,
    )


def _coverage(flash: Log, telemetry: Log) -> Iterator[Note]:
    """Said where runs may be missed because the steering is known for a part of the log only."""
    if flash.applet is not None or not telemetry.steering:
        return
    (a, b), (c, d) = extent(flash), extent(telemetry)
    if c > a + UNCOVERED or d < b - UNCOVERED:
        yield Note(
            "warning",
            f"The telemetry log covers {c:.0f} to {d:.0f} s of the log's {a:.0f} to {b:.0f} s: "
            "runs outside are left out",
        )


def ranked_steering(flash: Log, telemetry: Log) -> tuple[Signal, ...]:
    """The applet's own staircase first, then the others by their rate."""
    own = [s for s in flash.steering if s.hold]
    sampled = [s for s in (*flash.steering, *telemetry.steering) if s not in own]
    return (*own, *sorted(sampled, key=lambda s: -s.rate))


def overlap(one: Log, other: Log) -> float:
    """Seconds of vehicle time that both logs cover."""
    (a, b), (c, d) = extent(one), extent(other)
    return min(b, d) - max(a, c)


def extent(log: Log) -> tuple[float, float]:
    """First and last vehicle time [s] of any signal."""
    signals = [s for s in (*log.signals.values(), *log.steering) if s.t.size]
    return min((float(s.t[0]) for s in signals), default=0.0), max(
        (float(s.t[-1]) for s in signals), default=0.0
    )


def _extent(log: Log) -> str:
    start, end = extent(log)
    return f"{start:.0f} to {end:.0f} s after boot"


def _disagreement(flash: Log, telemetry: Log) -> tuple[float, float]:
    """Rms difference [us] of the two logs' steering outputs where both have one, and its spread."""
    if not flash.steering or not telemetry.steering:
        return 0.0, 0.0
    coarse, fine = flash.steering[-1], telemetry.steering[0]
    inside = (coarse.t > fine.t[0]) & (coarse.t < fine.t[-1])
    if not np.any(inside):
        return 0.0, 0.0
    difference = coarse.x[inside] - np.interp(coarse.t[inside], fine.t, fine.x)
    return float(np.sqrt(np.mean(difference**2))), float(np.std(coarse.x[inside]))
