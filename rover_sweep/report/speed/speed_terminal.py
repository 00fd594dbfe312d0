"""The response of the speed to the throttle in a few lines."""

from __future__ import annotations

from collections.abc import Iterator

from rover_sweep.identification.speed.identify_speed import SpeedResult
from rover_sweep.identification.speed.speed_parameters import driving_drag


def speed_answer(result: SpeedResult) -> Iterator[str]:
    """The answer, line by line: verdict, numbers with 90 % intervals, drag, and what to do next."""
    low, mean, high = result.speeds
    many = f"{len(result.runs)} throttle sweeps" if len(result.runs) > 1 else "1 throttle sweep"
    yield f"Speed from {many}, {low:.2f} to {high:.2f} m/s: {result.level}."
    for reason in result.reasons:
        yield f"  because {reason}"
    if result.fit is None:
        return
    m, ends, travel = result.fit.model, result.fit.intervals, abs(result.runs[0].travel_us)
    band = result.coherence.band if result.coherence else None
    yield (
        f"  gain   {m.gain:.3g} m/s per full throttle {_ends(ends['gain'])}, "
        f"{1000 * m.gain / travel:.3g} mm/s per us"
    )
    yield f"  lag    {m.lag:.3g} s {_ends(ends['lag'])}"
    delay = [1000 * end for end in ends["delay"]]
    yield f"  delay  {1000 * m.delay:.0f} ms ({delay[0]:.0f} to {delay[1]:.0f}), with the EKF's"
    offset = [100 * end for end in ends["offset"]]
    yield (
        f"  offset {100 * m.offset:.1f} % throttle ({offset[0]:.1f} to {offset[1]:.1f}) before it moves: "
        "dead zone and drag"
    )
    yield from _drag(result)
    explained = f"explains {100 * result.fit.fit:.0f} % of the speed's variation"
    coherent = f"; coherent from {band[0]:.2g} to {band[1]:.2g} rad/s" if band else ""
    yield f"  the law {explained}{coherent}. Intervals: 90 %."


def _drag(result: SpeedResult) -> Iterator[str]:
    assert result.fit is not None
    found, mean = result.coasting, result.speeds[1]
    driving, ends = driving_drag(result.fit, mean)
    yield (
        f"  drag   of drive and road {driving:.2f} m/s2 ({ends[0]:.2f} to {ends[1]:.2f}) at {mean:.2f} m/s, "
        "while it drives"
    )
    if found is None:
        yield "         coasting not recorded: let the rover roll out with the throttle at neutral"
        return
    low, high = found.interval
    yield (
        f"         coasting {found.deceleration:.2f} m/s2 ({low:.2f} to {high:.2f}) at {found.speed:.2f} "
        f"m/s, over {found.seconds:.1f} s"
    )
    if found.dead_zone is None or found.dead_zone_interval is None:
        yield "         the motor freewheels at neutral, so dead zone and drag cannot be told apart"
        return
    low, high = found.dead_zone_interval
    zone = max(100 * found.dead_zone, 0.0)
    yield f"  dead zone {zone:.1f} % throttle ({100 * max(low, 0.0):.1f} to {100 * max(high, 0.0):.1f})"


def _ends(ends: tuple[float, float]) -> str:
    return f"({ends[0]:.3g} to {ends[1]:.3g})"
