"""Parameters: read, written, read back and compared as the float32 that MAVLink carries."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.vehicle.link import Link
from rover_sweep.vehicle.mavlink import Message

_REAL32 = 9  # MAV_PARAM_TYPE_REAL32
_TRIES, _TIMEOUT = 4, 1.0
_BOOTED = 20.0  # s since boot
_LISTS = 3  # how often a list is asked for that changes meanwhile


class ParameterMissing(LinkError):
    """The vehicle has no parameter of that name (or did not answer for it)."""


class ParameterKept(LinkError):
    """The vehicle has the parameter, and after it was set another value than it was given."""

    def __init__(self, name: str, wanted: float, kept: float) -> None:
        super().__init__(
            f"{name} was set to {wanted:g} but the vehicle has {kept:g}; "
            "it is read-only, of whole numbers, or out of its range"
        )


@dataclass(frozen=True)
class Written:
    """A parameter that was set and read back. old is None where it was not read before."""

    name: str
    old: float | None
    value: float

    @property
    def changed(self) -> bool:
        return self.old != self.value


def float32(value: float) -> float:
    """The value as MAVLink carries it."""
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def read(link: Link, name: str) -> float:
    """One parameter. ParameterMissing when the vehicle, otherwise alive, does not answer."""
    return float(_read(link, name).param_value)


def _read(link: Link, name: str) -> Message:
    for _ in range(_TRIES):
        link.to_vehicle("PARAM_REQUEST_READ", param_id=_encoded(name), param_index=-1)
        answer = link.wait_for("PARAM_VALUE", _TIMEOUT, lambda m: m.param_id == name)
        if answer is not None:
            return answer
    raise ParameterMissing(
        f"the vehicle has no parameter {name} (asked {_TRIES} times); is the name right, "
        "and for SWP_ ones, does the applet run?"
    )


def read_present(link: Link, names: Iterable[str]) -> dict[str, float]:
    """Those of `names` that the vehicle has, asked for all at once, and twice again where no answer came."""
    wanted, found = set(names), dict[str, float]()
    for patience in (_TIMEOUT, _TIMEOUT / 2, _TIMEOUT / 2):
        for name in sorted(wanted - found.keys()):
            link.to_vehicle("PARAM_REQUEST_READ", param_id=_encoded(name), param_index=-1)
        while wanted - found.keys():
            message = link.wait_for("PARAM_VALUE", patience, lambda m: m.param_id in wanted)
            if message is None:
                break
            found[message.param_id] = float(message.param_value)
    return found


def await_booted(link: Link, told: Callable[[float], None] | None = None) -> None:
    """Wait where the vehicle has just booted: the parameters of its drivers are not in its list before that
    (4.6.3: without a GPS's ten for some seconds). told: called with the s that it takes at most."""
    link.request_message("SYSTEM_TIME")
    left = _BOOTED - link.clock.now
    if not link.clock.known or left <= 0:
        return
    if told is not None:
        told(left)
    deadline = link.line.monotonic() + left
    while link.clock.now < _BOOTED and link.line.monotonic() < deadline:
        link.request_message("SYSTEM_TIME", timeout=0.5)
        link.receive(0.2)


def read_all(link: Link, progress: Callable[[int, int], None] | None = None) -> dict[str, float]:
    """Every parameter, by name. Missing ones are asked for by index; LinkError where some never come.

    A list that changes while it comes (parameters appear for some seconds after a boot, which moves the
    indices of others) is asked for anew.
    """
    for _ in range(_LISTS):
        found = _read_list(link, progress)
        if len(values := dict(found.values())) == len(found):
            return values
    raise LinkError(
        "the list of parameters changes while it comes; wait until the rover has booted, and try again"
    )


def _read_list(link: Link, progress: Callable[[int, int], None] | None) -> dict[int, tuple[str, float]]:
    """(name, value) by index."""
    link.to_vehicle("PARAM_REQUEST_LIST")
    found: dict[int, tuple[str, float]] = {}
    count, quiet = 0, 0
    while quiet < _TRIES and (count == 0 or len(found) < count):
        message = link.wait_for("PARAM_VALUE", _TIMEOUT)
        if message is None:
            quiet += 1
            _ask_again(link, found, count)
            continue
        if count not in (0, int(message.param_count)):
            found.clear()
            link.to_vehicle("PARAM_REQUEST_LIST")
        count, quiet = int(message.param_count), 0
        if message.param_index < count:
            found[int(message.param_index)] = (message.param_id, float(message.param_value))
        if progress is not None:
            progress(len(found), count)
    if count == 0 or len(found) < count:
        raise LinkError(
            f"only {len(found)} of {count} parameters came; the link loses too much, move closer or use USB"
        )
    return found


def _ask_again(link: Link, found: Mapping[int, object], count: int) -> None:
    if count == 0:
        link.to_vehicle("PARAM_REQUEST_LIST")
    for index in [i for i in range(count) if i not in found][:20]:
        link.to_vehicle("PARAM_REQUEST_READ", param_id=b"", param_index=index)


def write(link: Link, name: str, value: float) -> Written:
    """Set a parameter where it differs, read it back and compare as float32.

    ParameterMissing where there is none; ParameterKept where it came back other than it was sent.
    """
    before = _read(link, name)
    old, wanted = float(before.param_value), float32(value)
    if old == wanted:
        return Written(name, old, old)
    back = old
    for _ in range(_TRIES):
        link.to_vehicle(
            "PARAM_SET", param_id=_encoded(name), param_value=wanted, param_type=before.param_type or _REAL32
        )
        link.wait_for("PARAM_VALUE", _TIMEOUT, lambda m: m.param_id == name)
        back = read(link, name)
        if back == wanted:
            return Written(name, old, back)
    raise ParameterKept(name, value, back)


def write_all(link: Link, values: Mapping[str, float]) -> list[Written]:
    """`write` for each, in the order given."""
    return [write(link, name, value) for name, value in values.items()]


def _encoded(name: str) -> bytes:
    data = name.encode("ascii", "replace")
    if len(data) > 16:
        raise UsageError(f"{name} is no ArduPilot parameter: names have at most 16 characters")
    return data
