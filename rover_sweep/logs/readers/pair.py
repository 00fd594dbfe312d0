"""Merges a DataFlash log and the telemetry log of the same drive."""

from __future__ import annotations

from collections.abc import Iterator

from rover_sweep.data.recording import Note, Signal
from rover_sweep.errors import DataRefused
from rover_sweep.logs.log import Log, are_different, disagreement, sensor_filters

UNCOVERED = 30.0  # s of the log without telemetry; more gives a warning


def paired(flash: Log, telemetry: tuple[Log, ...]) -> Log:
    """The DataFlash log with the steering, and missing channels, of the telemetry log.

    Both have the vehicle's time since boot, so no alignment is needed; the steering outputs show whether they
    are of one drive. DataRefused when they are not.
    """
    match = max(telemetry, key=lambda log: overlap(flash, log))
    if overlap(flash, match) < 1.0:
        raise DataRefused(
            f"{flash.name} ({_extent(flash)}) and {match.name} ({_extent(match)}) have no vehicle time "
            "in common: give the two logs of one drive"
        )
    difference, spread = _disagreement(flash, match)
    if are_different(difference, spread):
        raise DataRefused(
            f"{flash.name} and {match.name} are not of one drive: their steering outputs differ by "
            f"{difference:.0f} us (rms) and vary by {spread:.0f} us; give the two logs of one drive"
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
    """A warning when the steering is known for a part of the log only, so runs may be missed."""
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
    """The steering outputs, best first: the applet's staircase, then the others by sampling rate."""
    own = [s for s in flash.steering if s.hold]
    sampled = [s for s in (*flash.steering, *telemetry.steering) if s not in own]
    return (*own, *sorted(sampled, key=lambda s: -s.rate))


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


def _extent(log: Log) -> str:
    start, end = extent(log)
    return f"{start:.0f} to {end:.0f} s after boot"


def _disagreement(flash: Log, telemetry: Log) -> tuple[float, float]:
    """(rms difference, standard deviation) [us] of the steering outputs where both have one."""
    if not flash.steering or not telemetry.steering:
        return 0.0, 0.0
    return disagreement(flash.steering[-1], telemetry.steering[0])
