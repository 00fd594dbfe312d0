"""What is said of a run's telemetry when it is over: how it came, and what it is needed for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rover_sweep.vehicle.link.streams import LOST, StreamQuality, poor_words
from rover_sweep.vehicle.preflight.observed import ClockComparison

Granted = Mapping[str, float]  # Hz by message, as the vehicle granted it


def telemetry_words(
    quality: Sequence[StreamQuality], granted: Granted, clock: ClockComparison | None, logs: bool
) -> str:
    """One sentence. logs: whether the vehicle's own log is fetched at the end of the session."""
    poor = [words for q in quality if (words := poor_words(q, granted.get(q.message, 0.0)))]
    came = "; ".join(poor) if poor else _came(quality)
    return f"telemetry: {came}{_clock(clock)}; {_source(bool(poor), logs)}"


def _came(quality: Sequence[StreamQuality]) -> str:
    if not quality:
        return "not judged"
    slowest, fastest = min(q.mean_hz for q in quality), max(q.mean_hz for q in quality)
    rates = f"{slowest:.0f}" if round(slowest) == round(fastest) else f"{slowest:.0f} to {fastest:.0f}"
    lost = max(q.lost for q in quality)
    return (
        f"{rates} Hz, jitter {max(q.jitter_ms for q in quality):.1f} ms, "
        f"longest gap {max(q.gap_ms for q in quality):.0f} ms, {f'{lost:.1%}' if lost else 'nothing'} lost"
    )


def _clock(c: ClockComparison | None) -> str:
    """Nothing of a simulation that is not in real time, where arrival tells nothing."""
    if c is None or abs(c.rate - 1) > 0.02:
        return ""
    drift = f", drift {1e6 * c.drift:+.0f} ppm" if abs(c.drift) > c.bound else ""
    return f", arrival within {1000 * c.jitter:.0f} ms of the rover's clock{drift}"


def _source(poor: bool, logs: bool) -> str:
    if logs:
        need = "needed: the telemetry alone would not do" if poor else "the telemetry would do without it"
        return f"identified from the rover's log, once it is fetched ({need})"
    if poor:
        return f"identified from it, though more than {LOST:.0%} lost or longer gaps spoil a response"
    return "identified from it, since the log is not fetched"
