"""A sentence on the telemetry of a finished run: its quality, and whether it is needed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rover_sweep.vehicle.link.streams import LOST, StreamQuality, stream_fault
from rover_sweep.vehicle.preflight.observed import ClockComparison

Granted = Mapping[str, float]  # Hz by message, as the vehicle granted it


def telemetry_words(
    quality: Sequence[StreamQuality], granted: Granted, clock: ClockComparison | None, logs: bool
) -> str:
    """One sentence. granted: rates [Hz]. logs: whether the vehicle's log is fetched after the session."""
    poor = [words for q in quality if (words := stream_fault(q, granted.get(q.message, 0.0)))]
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
    """'' in a simulation that is not in real time: there the arrival has no meaning."""
    if c is None or abs(c.rate - 1) > 0.02:
        return ""
    drift = f", drift {1e6 * c.drift:+.0f} ppm" if abs(c.drift) > c.bound else ""
    return f", arrival within {1000 * c.jitter:.0f} ms of the rover's clock{drift}"


def _source(poor: bool, logs: bool) -> str:
    if logs:
        need = "needed: the telemetry is too poor" if poor else "the telemetry would also be good enough"
        return f"the run is identified from the rover's log, once it is fetched ({need})"
    if poor:
        return (
            f"the run is identified from the telemetry, although losses above {LOST:.0%} or long gaps spoil "
            "a response"
        )
    return "the run is identified from the telemetry, because the log is not fetched"
