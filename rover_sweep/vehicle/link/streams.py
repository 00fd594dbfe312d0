"""Rates of the vehicle's messages: requested, granted or denied, and measured after a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from statistics import median

from rover_sweep.logs.readers.vehicle_clock import WRAP
from rover_sweep.vehicle.link.connection import vehicle_seconds
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import Message, kind, message_id

_ACCEPTED, _DENIED, _UNSUPPORTED = 0, 2, 3
LOST = 0.02  # share of lost samples above which a response is spoilt
_GAP, _DELIVERED = 0.25, 0.9  # s: a period of 25 rad/s; share of what was granted

# Rates in Hz: more than ten times the top of a 25 rad/s sweep, and granted from a loop rate of 100 Hz on.
# LOCAL_POSITION_NED is only sent when the EKF has an origin.
IDENTIFICATION_RATES: Mapping[str, float] = {
    "SERVO_OUTPUT_RAW": 50.0,
    "RAW_IMU": 50.0,
    "ATTITUDE": 50.0,
    "LOCAL_POSITION_NED": 50.0,
    "RC_CHANNELS": 10.0,
    "SYSTEM_TIME": 1.0,
}


@dataclass(frozen=True)
class Stream:
    """A message's rate. wanted_hz: requested; hz: granted (0: not sent); advice: what to change, else ''."""

    message: str
    wanted_hz: float
    hz: float
    advice: str = ""


def fastest_interval_ms(loop_rate: float) -> int:
    """Shortest interval that ArduPilot grants [whole ms]: loop 50 -> 25, 100 -> 12, 400 -> 3.

    GCS_MAVLINK::cap_message_interval (4.6.3): denied below loop period / 800.
    """
    return int(1e6 / loop_rate / 800)


def loop_rate_for(hz: float) -> int:
    """Smallest usual SCHED_LOOP_RATE that grants `hz`."""
    return next((rate for rate in (50, 100, 200, 300, 400) if 1000 / fastest_interval_ms(rate) >= hz), 400)


def request(link: Link, name: str, hz: float, loop_rate: float) -> Stream:
    """Request a message at `hz`; if that is denied, at the highest rate that the loop rate [Hz] allows."""
    if _set(link, name, 1e6 / hz) == _ACCEPTED:
        return Stream(name, hz, 1000 / int(1000 / hz))
    fastest = fastest_interval_ms(loop_rate)
    if 1000 / hz < fastest and _set(link, name, fastest * 1000) == _ACCEPTED:
        capped = 1000 / fastest
        return Stream(
            name,
            hz,
            capped,
            f"the vehicle denies {name} at {hz:g} Hz: SCHED_LOOP_RATE {loop_rate:g} allows at most "
            f"{capped:.0f} Hz; set SCHED_LOOP_RATE to {loop_rate_for(hz)} and reboot",
        )
    return Stream(name, hz, 0.0, f"this vehicle does not send {name}")


def grants(link: Link, name: str, loop_rate: float) -> bool:
    """Whether the vehicle grants the highest rate of a loop of `loop_rate` Hz, which shows that it runs at
    that rate. The message then returns to its default rate."""
    granted = _set(link, name, fastest_interval_ms(loop_rate) * 1000) == _ACCEPTED
    _set(link, name, 0)
    return granted


def request_all(
    link: Link, loop_rate: float, rates: Mapping[str, float] = IDENTIFICATION_RATES
) -> tuple[Stream, ...]:
    """`request` for each message."""
    return tuple(request(link, name, hz, loop_rate) for name, hz in rates.items())


def stop(link: Link, names: Iterable[str]) -> None:
    """Stop these messages (after a run, so that log downloads can use the full line)."""
    for name in names:
        _set(link, name, -1)


def intervals(link: Link, names: Iterable[str]) -> dict[str, float]:
    """Present interval of each message [us], -1 if it is not sent; without those that the vehicle does not
    report (MAV_CMD_GET_MESSAGE_INTERVAL)."""
    found: dict[int, float] = {}

    def keep(message: Message) -> None:
        if kind(message) == "MESSAGE_INTERVAL":
            found[int(message.message_id)] = float(message.interval_us)

    numbers = {name: message_id(name) for name in names}
    with link.listening(keep):
        for number in numbers.values():
            link.command("MAV_CMD_GET_MESSAGE_INTERVAL", number)
        link.receive(0.05)
    return {name: found[number] for name, number in numbers.items() if found.get(number)}


def put_back(link: Link, before: Mapping[str, float]) -> None:
    """Restore the intervals [us] that `intervals` found."""
    for name, interval_us in before.items():
        _set(link, name, interval_us)


def _set(link: Link, name: str, interval_us: float) -> int:
    return link.command("MAV_CMD_SET_MESSAGE_INTERVAL", message_id(name), interval_us)


@dataclass(frozen=True)
class StreamQuality:
    """The measured quality of a stream, on the vehicle's clock. count: samples; hz: by the median interval;
    jitter_ms: standard deviation of the intervals; gap_ms: longest interval; lost: share of the samples that
    did not arrive; mean_hz: samples per second."""

    message: str
    count: int
    hz: float
    jitter_ms: float
    gap_ms: float
    lost: float
    mean_hz: float = 0.0


def stream_fault(q: StreamQuality, granted: float, gap: float = _GAP) -> str:
    """A sentence if a stream is too poor for identification, else ''.

    granted: rate [Hz], 0 if unknown. gap: longest allowed interval [s].
    """
    if q.count < 3:
        return f"{q.message} arrived only {q.count} times"
    granted = granted or q.hz
    if not (q.lost > LOST or q.gap_ms > 1000 * gap or q.mean_hz < _DELIVERED * granted):
        return ""
    return (
        f"{q.message} arrives {q.mean_hz:.1f} times a second instead of {granted:.0f}, "
        f"{q.lost:.0%} did not arrive, longest gap {q.gap_ms:.0f} ms"
    )


@dataclass
class StreamMonitor:
    """A listener of the link that keeps the vehicle's time stamps of the messages in `names` [s]."""

    names: frozenset[str]
    _stamps: dict[str, list[float]] = field(default_factory=dict)

    def __call__(self, message: Message) -> None:
        name = kind(message)
        if name not in self.names:
            return
        seconds = message.time_usec * 1e-6 if name == "SERVO_OUTPUT_RAW" else vehicle_seconds(message)
        if seconds is not None:
            self._keep(name, seconds)

    def _keep(self, name: str, seconds: float) -> None:
        stamps = self._stamps.setdefault(name, [])
        if name == "SERVO_OUTPUT_RAW" and stamps:
            seconds += WRAP * round((stamps[-1] - seconds) / WRAP)
        stamps.append(seconds)

    def quality(self) -> tuple[StreamQuality, ...]:
        """Quality of each message in `names`, in alphabetical order."""
        return tuple(stream_quality(name, self._stamps.get(name, [])) for name in sorted(self.names))


def stream_quality(name: str, stamps: list[float]) -> StreamQuality:
    """Rate, jitter and gaps from time stamps [s], in any order and possibly repeated (a radio may deliver
    messages out of order).

    The rate comes from the median interval, because ArduPilot sends at intervals of whole ms.
    """
    ordered = sorted(set(stamps))
    steps = [b - a for a, b in zip(ordered, ordered[1:], strict=False)]
    if len(steps) < 2:
        return StreamQuality(name, len(ordered), 0.0, 0.0, 0.0, 1.0)
    typical = median(steps)
    mean = sum(steps) / len(steps)
    jitter = (sum((s - mean) ** 2 for s in steps) / len(steps)) ** 0.5
    missing = sum(max(round(s / typical) - 1, 0) for s in steps if s > 2.5 * typical)
    return StreamQuality(
        name,
        len(ordered),
        hz=1 / typical,
        jitter_ms=1e3 * jitter,
        gap_ms=1e3 * max(steps),
        lost=missing / (len(ordered) + missing),
        mean_hz=1 / mean,
    )
