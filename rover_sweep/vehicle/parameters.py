"""Reads and writes parameters; values are read back and compared as float32, as MAVLink carries them."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firmware_params.param_files import WantedParameter, read, shipped
from rover_sweep.errors import LinkError, UsageError
from rover_sweep.files.documents import printable
from rover_sweep.vehicle.link.inbox import LONGEST, BadLink
from rover_sweep.vehicle.link.link import Link, MavsdkOnLink
from rover_sweep.vehicle.link.mavlink import Message, kind

if TYPE_CHECKING:
    from mavsdk.plugins.param import Param

_REAL32 = 9  # MAV_PARAM_TYPE_REAL32
_TRIES, _TIMEOUT = 4, 1.0
_ROUNDS = 3  # of requests for many at once
_HOLE = 2.0  # s of silence: more than the period of heartbeats
_FRESH = 5.0  # s within which an answer shows how slow the link is
_ANSWERS = ("PARAM_VALUE", "PARAM_ERROR")
# MAV_PARAM_ERROR (common.xml; ArduPilot after 4.6 answers with it, older versions do not answer)
_ERRORS = {
    2: "the value is out of its range",
    3: "the vehicle does not allow setting it",
    5: "it is read-only",
}
_NOT_THERE = 1
_STUCK = 3.0  # s in which only parameters come that are already known
_CHANGES = 20  # most changes of a list's length during its transfer
_BOOTED = 20.0  # s since boot
_LISTS = 3  # how often a list is requested that changes during its transfer


class ParameterMissing(LinkError):
    """The vehicle has no parameter of that name: it says so, or does not answer on a good link."""


class ParameterKept(LinkError):
    """The vehicle has the parameter, but did not keep the value it was set to."""

    def __init__(self, name: str, wanted: float, kept: float, why: str = "") -> None:
        why = why or "it may be read-only, an integer, or out of its range"
        super().__init__(f"{name} was set to {wanted:g} but the vehicle has {kept:g}; {why}")


@dataclass(frozen=True)
class ParameterSet:
    """A parameter was set and read back. old: before; reboot: the value takes effect after a reboot."""

    name: str
    old: float | None
    value: float
    reboot: bool = False

    @property
    def changed(self) -> bool:
        return self.old != self.value


def float32(value: float) -> float:
    """The value as MAVLink carries it."""
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def read_parameter(link: Link, name: str) -> float:
    """One parameter. ParameterMissing if the vehicle reports that it does not have it, or does not answer
    over a good link; BadLink if it does not answer over a poor one."""
    return float(_read(link, name).param_value)


def _read(link: Link, name: str) -> Message:
    tries, slow = 0, link.quality.latency is None
    began = link.line.monotonic()
    while tries < link.quality.tries(_TRIES) or (slow and link.line.monotonic() - began < LONGEST):
        tries += 1
        _ask(link, name)
        answer = _answer(link, (name,), link.quality.wait(_TIMEOUT))
        if answer is not None and kind(answer) == "PARAM_VALUE":
            return answer
        if answer is not None and answer.error == _NOT_THERE:
            raise ParameterMissing(f"the vehicle reports that it has no parameter {name}; {_WHY_MISSING}")
    if not link.quality.concludes(tries):
        raise BadLink(f"the vehicle did not answer for the parameter {name} in {tries} tries: {_bad(link)}")
    raise ParameterMissing(f"the vehicle has no parameter {name} (asked {tries} times); {_WHY_MISSING}")


_WHY_MISSING = "is the name right? SWP_ parameters exist only while the applet runs"


def _ask(link: Link, name: str) -> None:
    link.asked(("PARAM_VALUE", name))
    link.to_vehicle("PARAM_REQUEST_READ", param_id=_encoded(name), param_index=-1)


def _answer(link: Link, names: Collection[str], patience: float) -> Message | None:
    """The next answer for one of `names` within `patience` s. While not even heartbeats come, the wait
    continues, because a missing answer then means nothing (the link raises when silent for too long)."""
    while True:
        answer = link.wait_for(_ANSWERS, patience, lambda m: m.param_id in names)
        if answer is not None or link.quality.silence < _HOLE:
            return answer


def _bad(link: Link) -> str:
    return link.quality.words or "the link loses too much; go closer or use USB"


def read_present(link: Link, names: Iterable[str]) -> dict[str, float]:
    """Those of `names` that the vehicle has. They are requested all at once, and repeated where no answer
    came: twice, or more often if the link loses frames.

    BadLink if answers are missing and the link is too poor to conclude that the parameters do not exist.
    """
    wanted, found = set(names), dict[str, float]()
    began, rounds = link.line.monotonic(), 0
    while (left := wanted - found.keys()) and rounds < link.quality.tries(_ROUNDS, len(wanted)):
        for name in sorted(left):
            _ask(link, name)
        _collect(link, wanted, found, link.quality.wait(_TIMEOUT / min(rounds + 1, 2)))
        rounds += 1
    if not found and len(left) > 1 and link.quality.unanswered > _FRESH:  # absent, or the link became slow
        _collect(link, wanted, found, LONGEST - (link.line.monotonic() - began))
    left = wanted - found.keys()
    if left and not link.quality.concludes(rounds, len(wanted)):
        raise BadLink(
            f"the vehicle did not answer for {_named(left)} in {rounds} rounds of requests: {_bad(link)}"
        )
    return found


def _collect(link: Link, wanted: set[str], found: dict[str, float], patience: float) -> None:
    """Add answers to `found`, and remove missing parameters from `wanted`, until nothing came for `patience`
    s."""
    while names := wanted - found.keys():
        message = _answer(link, names, patience)
        if message is None:
            return
        if kind(message) == "PARAM_VALUE":
            found[message.param_id] = float(message.param_value)
        elif message.error == _NOT_THERE:
            wanted.discard(message.param_id)


def _named(names: Collection[str]) -> str:
    some = sorted(names)[:3]
    return ", ".join(some) + (f" and {len(names) - len(some)} more parameters" if len(names) > 3 else "")


def await_booted(link: Link, waits: Callable[[float], None] | None = None) -> None:
    """Wait if the vehicle has just booted: its list lacks the parameters of its drivers at first (4.6.3: ten
    of the GPS for some seconds). waits: called with the longest remaining time [s]."""
    link.request_message("SYSTEM_TIME")
    left = _BOOTED - link.clock.now
    if not link.clock.known or left <= 0:
        return
    if waits is not None:
        waits(left)
    deadline = link.line.monotonic() + left
    while link.clock.now < _BOOTED and link.line.monotonic() < deadline:
        link.request_message("SYSTEM_TIME", timeout=0.5)
        link.receive(0.2)


def read_all(link: Link, progress: Callable[[int, int], None] | None = None) -> dict[str, float]:
    """Every parameter, by name. Missing ones are requested by index; LinkError if some never come.

    A list that changes during its transfer (for some seconds after a boot, parameters appear and shift the
    indices of others) is requested again.
    """
    for _ in range(_LISTS):
        found = _read_list(link, progress)
        if len(values := dict(found.values())) == len(found):
            return values
    raise LinkError(
        "the list of parameters changed during its transfer; wait until the rover has booted, and try again"
    )


def _read_list(link: Link, progress: Callable[[int, int], None] | None) -> dict[int, tuple[str, float]]:
    """(name, value) by index."""
    link.to_vehicle("PARAM_REQUEST_LIST")
    found: dict[int, tuple[str, float]] = {}
    count, quiet, changes, news = 0, 0, 0, link.line.monotonic()
    while quiet < link.quality.tries(_TRIES) and changes < _CHANGES and (count == 0 or len(found) < count):
        message = link.wait_for("PARAM_VALUE", link.quality.wait(_TIMEOUT))
        if message is None or link.line.monotonic() - news > link.quality.wait(_STUCK):
            quiet, news = quiet + 1, link.line.monotonic()
            _ask_again(link, found, count)
            continue
        if count not in (0, int(message.param_count)):
            found.clear()
            changes += 1
            link.to_vehicle("PARAM_REQUEST_LIST")
        count = int(message.param_count)
        if message.param_index < count and message.param_index not in found:
            quiet, news = 0, link.line.monotonic()
        if message.param_index < count:
            found[int(message.param_index)] = (message.param_id, float(message.param_value))
        if progress is not None:
            progress(len(found), count)
    if count == 0 or len(found) < count:
        raise BadLink(f"only {len(found)} of {count} parameters arrived: {_bad(link)}")
    return found


def _ask_again(link: Link, found: Mapping[int, object], count: int) -> None:
    if count == 0:
        link.to_vehicle("PARAM_REQUEST_LIST")
    for index in [i for i in range(count) if i not in found][:20]:
        link.to_vehicle("PARAM_REQUEST_READ", param_id=b"", param_index=index)


def write_parameter(link: Link, name: str, value: float) -> ParameterSet:
    """Set a parameter if it differs, read it back and compare as float32.

    ParameterMissing if there is none; ParameterKept if the vehicle does not keep the value.
    """
    before = _read(link, name)
    old, wanted = float(before.param_value), float32(value)
    if old == wanted:
        return ParameterSet(name, old, old)
    back, tries = old, 0
    while tries < link.quality.tries(_TRIES):
        tries += 1
        link.to_vehicle(
            "PARAM_SET", param_id=_encoded(name), param_value=wanted, param_type=before.param_type or _REAL32
        )
        echo = link.wait_for(_ANSWERS, link.quality.wait(_TIMEOUT), lambda m: m.param_id == name)
        if echo is not None and kind(echo) == "PARAM_ERROR" and echo.error in _ERRORS:
            raise ParameterKept(name, value, old, _ERRORS[echo.error])
        back = read_parameter(link, name)
        if back == wanted:
            return ParameterSet(name, old, back)
    if not link.quality.concludes(tries):
        raise BadLink(f"{name} could not be set to {value:g} in {tries} tries: {_bad(link)}")
    raise ParameterKept(name, value, back)


def _encoded(name: str) -> bytes:
    data = name.encode("ascii", "replace")
    if len(data) > 16:
        raise UsageError(f"{name} is not an ArduPilot parameter: names have at most 16 characters")
    return data


# Reads a .param file, and refuses a faulty one before the rover is contacted.


_LONGEST = 16  # characters of a name in MAVLink
_LARGEST = 3.4e38  # of a float32
# Parameters that the vehicle writes, which an older file must not restore: counters (STAT_BOOTCNT shows
# reboots, see `setup.note`), the air pressure at boot, sizes of stored lists (seen in 4.6.3).
_ITS_OWN = re.compile(
    r"STAT_(?!RESET$).*|BARO\d_GND_PRESS|SYS_NUM_RESETS|FORMAT_VERSION|(MIS|FENCE|RALLY)_TOTAL"
)


def written_by_vehicle(name: str) -> bool:
    """Whether the vehicle writes the parameter, so that it is neither compared nor set."""
    return _ITS_OWN.fullmatch(name) is not None


def wanted_of(file: str) -> tuple[WantedParameter, ...]:
    """The parameters of a file, or of a shipped one by its name (identification, raw_imu).

    Without those that a vehicle writes. UsageError if the file cannot be read, holds no parameter, or one
    that no vehicle can have.
    """
    path = Path(file)
    try:
        wanted = read(path if path.exists() else shipped(file))
    except UnicodeDecodeError:
        raise UsageError(
            f"{file} is not a parameter file: it is not text; give one with lines NAME VALUE"
        ) from None
    except OSError as error:
        raise UsageError(f"{file} cannot be read ({error.strerror}); give a .param file") from error
    except ValueError as error:
        words = str(error) if path.exists() else f"there is no file {file}, and {error}"
        raise UsageError(f"{words}; give a .param file with lines NAME VALUE") from error
    if not wanted:
        raise UsageError(f"{file} holds no parameter; give a .param file with lines NAME VALUE")
    for parameter in wanted:
        if len(parameter.name) > _LONGEST or not parameter.name.isascii():
            raise UsageError(
                f"{file}: {parameter.name} is not a parameter of ArduPilot, whose names have at most "
                f"{_LONGEST} characters"
            )
        if not abs(parameter.value) < _LARGEST:
            raise UsageError(
                f"{file}: {parameter.name} {parameter.value:g} is not a value that a rover can hold"
            )
    return tuple(parameter for parameter in wanted if not written_by_vehicle(parameter.name))


# The vehicle's parameters by MAVSDK's param plugin, with the interface of `sources.ParameterSource`.


@dataclass(frozen=True)
class MavsdkParameters:
    """MAVSDK distinguishes integers and floats; here all are floats, as in MAVLink."""

    link: Link

    def read_all(self, progress: Callable[[int, int], None] | None = None) -> dict[str, float]:
        """Every parameter, by name. MAVSDK reports no progress. LinkError if none came."""
        with MavsdkOnLink(self.link) as mavsdk:
            found = mavsdk.call(_plugin(mavsdk).get_all_params)
        values = {printable(p.name): float(p.value) for p in (*found.int_params, *found.float_params)}
        if not values:
            raise LinkError("MAVSDK received no parameters: the link loses too much; use --via mavlink")
        if progress is not None:
            progress(len(values), len(values))
        return values

    def write(self, name: str, value: float) -> ParameterSet:
        """Set a parameter if it differs, read it back and compare as float32, as `read_write.write`."""
        with MavsdkOnLink(self.link) as mavsdk:
            plugin = _plugin(mavsdk)
            old, whole = _read_by_mavsdk(mavsdk, plugin, name)
            wanted = float32(value)
            if old == wanted:
                return ParameterSet(name, old, old)
            set_it: Callable[[str, Any], object] = plugin.set_param_int if whole else plugin.set_param_float
            given = int(wanted) if whole else wanted
            with suppress(LinkError):  # a value that is refused reads back as the old one
                _tried(mavsdk, name, lambda: set_it(name, given))
            back, _ = _read_by_mavsdk(mavsdk, plugin, name)
        if back != wanted:
            raise ParameterKept(name, value, back)
        return ParameterSet(name, old, back)


def _plugin(mavsdk: MavsdkOnLink) -> Param:
    from mavsdk.plugins.param import Param

    return Param(mavsdk.system)


def _read_by_mavsdk(mavsdk: MavsdkOnLink, plugin: Param, name: str) -> tuple[float, bool]:
    """(value, whether it is an integer). MAVSDK must be asked with the right type."""
    from mavsdk.plugins.param import ParamError

    try:
        return float32(mavsdk.call(lambda: plugin.get_param_float(name))), False
    except ParamError as error:
        if "WRONG_TYPE" not in str(error):
            raise ParameterMissing(f"MAVSDK did not receive the parameter {name} ({error})") from error
    return float32(_tried(mavsdk, name, lambda: plugin.get_param_int(name))), True


def _tried(mavsdk: MavsdkOnLink, name: str, call: Callable[[], Any]) -> Any:
    from mavsdk.plugins.param import ParamError

    try:
        return mavsdk.call(call)
    except ParamError as error:
        raise LinkError(f"MAVSDK could not read or set {name} ({error})") from error
