"""The content of session.json, as frozen values and as JSON."""

from __future__ import annotations

import reprlib
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal, get_args

from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import BiasSweep, Doublet, Manoeuvre, Sweep, ThrottleSweep

# Checked reading of session.json, which may be truncated or edited by hand.


@dataclass(frozen=True)
class Kind:
    """The required kind of a value. words: completes "it is 3, not ..."."""

    words: str
    holds: Callable[[Any], bool]


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and value not in ("", ".", "..") and not set(value) & set("/\\\0")


OBJECT = Kind("an object", lambda x: isinstance(x, dict))
LIST = Kind("a list", lambda x: isinstance(x, list))
TEXT = Kind("a text", lambda x: isinstance(x, str))
NAME = Kind("a name without a folder", _is_name)
WHOLE = Kind("a whole number", lambda x: type(x) is int and abs(x) < 2**64)
FLAG = Kind("true or false", lambda x: isinstance(x, bool))
NUMBER = Kind(
    "a finite number",
    lambda x: type(x) in (int, float) and abs(x) <= sys.float_info.max,  # NaN is not
)


def one_of(words: tuple[str, ...]) -> Kind:
    """One of these words."""
    return Kind(f"one of {', '.join(words)}", lambda x: isinstance(x, str) and x in words)


class Entry:
    """An object at a place in the file. ValueError gives the place of a missing or wrong value."""

    def __init__(self, value: Any, place: str = "") -> None:
        self._values, self._place = checked(value, OBJECT, place or "the whole"), place

    def get(self, key: str, kind: Kind, null: bool = False) -> Any:
        """The value of `key`; null: None is allowed too."""
        if key not in self._values:
            raise ValueError(f"{self.place(key)} is missing")
        value = self._values[key]
        return None if null and value is None else checked(value, kind, self.place(key))

    def each(self, key: str, kind: Kind) -> Iterator[tuple[Any, str]]:
        """The values of a list, each with its place."""
        for number, value in enumerate(self.get(key, LIST)):
            place = f"{self.place(key)}[{number}]"
            yield checked(value, kind, place), place

    def numbers(self, key: str) -> dict[str, float]:
        """An object with numbers only."""
        entry = Entry(self.get(key, OBJECT), self.place(key))
        return {name: entry.get(name, NUMBER) for name in entry._values}

    def place(self, key: str) -> str:
        """The place of a value in this object."""
        return f"{self._place}.{key}" if self._place else key

    def only(self, keys: tuple[str, ...]) -> None:
        """ValueError for any other key: an unknown value would be lost when the file is written again."""
        for key in self._values:
            if key not in keys:
                raise ValueError(f"this rover-sweep does not know {self.place(key)}")

    def __contains__(self, key: str) -> bool:
        return key in self._values


def checked(value: Any, kind: Kind, place: str) -> Any:
    """The value; ValueError where it is of another kind."""
    if not kind.holds(value):
        raise ValueError(f"{place} is {reprlib.repr(value)}, not {kind.words}")
    return value


FORMAT = "rover-sweep session 2"

# begun: being driven; done: came to its end; stopped: by applet, pilot or abort; cut: link or program died.
State = Literal["begun", "done", "stopped", "cut"]
Span = tuple[float, float]
KINDS: Mapping[str, type[Manoeuvre]] = {
    "sweep": Sweep,
    "bias_sweep": BiasSweep,
    "doublet": Doublet,
    "multisine": Multisine,
    "throttle": ThrottleSweep,
}


@dataclass(frozen=True)
class SessionRun:
    """One run of a session's plan. name: of its .tlog; speed: the speed to hold [m/s], None if unknown."""

    name: str
    manoeuvre: Manoeuvre
    speed: float | None = None


@dataclass(frozen=True)
class DrivenRun:
    """A run that was started. name: in the plan; tlog: file name in the folder, different for each repeat.

    manoeuvre: None if the tlog does not hold it. reason: why it ended, a phrase. span: from the switch to the
    last state [s since boot]. number: the applet's run counter. left_armed: this program may have left the
    rover armed. quality: of the telemetry streams. verdict: as `live.snapshot.Verdict`.
    """

    name: str
    tlog: str
    manoeuvre: Manoeuvre | None
    state: State
    reason: str = ""
    span: Span | None = None
    number: int = 0
    left_armed: bool = False
    quality: tuple[Mapping[str, Any], ...] = ()
    verdict: Mapping[str, Any] | None = None

    @property
    def label(self) -> str:
        """The run's name, with a number if it is a repeat."""
        return self.tlog.removesuffix(".tlog")


@dataclass(frozen=True)
class FetchedLog:
    """A fetched log. number, size [bytes], time_utc [s since 1970]: as the vehicle lists it.

    runs: labels of the runs that it holds completely.
    """

    file: str
    number: int
    size: int
    time_utc: int
    runs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Content:
    """A session. vehicle: as `vehicle.identity.VehicleIdentity`; settings, parameters: set for driving.

    logs_before: (number, size, time_utc) of the logs on the vehicle when the session began; None: unknown.
    """

    vehicle: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    plan: tuple[SessionRun, ...] = ()
    runs: tuple[DrivenRun, ...] = ()
    logs: tuple[FetchedLog, ...] = ()
    logs_before: tuple[tuple[int, int, int], ...] | None = None

    @property
    def to_drive(self) -> tuple[SessionRun, ...]:
        """The planned runs not completed yet, in the order of the plan."""
        done = {(run.name, run.manoeuvre) for run in self.runs if run.state == "done"}
        return tuple(run for run in self.plan if (run.name, run.manoeuvre) not in done)

    @property
    def left_armed(self) -> bool:
        """Whether the last run may have left the rover armed; an earlier one is known to be over."""
        return bool(self.runs) and self.runs[-1].left_armed

    def run(self, label: str) -> DrivenRun:
        """The run of that label. KeyError without one."""
        return {run.label: run for run in self.runs}[label]


def to_json(content: Content) -> dict[str, Any]:
    """As plain values for JSON."""
    return {"format": FORMAT, "span_unit": "s since boot"} | asdict(content)


def from_json(data: Any) -> Content:
    """The reverse of `to_json`. ValueError for other data, with the place and the value there."""
    top = Entry(data)
    before = top.get("logs_before", LIST, null=True)
    return Content(
        vehicle=_vehicle(top),
        settings=_settings(top),
        parameters=top.numbers("parameters"),
        plan=tuple(_planned(Entry(*run)) for run in top.each("plan", OBJECT)),
        runs=tuple(_run(Entry(*run)) for run in top.each("runs", OBJECT)),
        logs=tuple(_log(Entry(*log)) for log in top.each("logs", OBJECT)),
        logs_before=None if before is None else tuple(_listed(*log) for log in top.each("logs_before", LIST)),
    )


def _vehicle(top: Entry) -> Mapping[str, Any]:
    values: Mapping[str, Any] = top.get("vehicle", OBJECT)
    entry = Entry(values, "vehicle")
    for key, kind in (("firmware", TEXT), ("uid", WHOLE)):
        if key in entry:
            entry.get(key, kind)
    return values


def _settings(top: Entry) -> Mapping[str, Any]:
    values: Mapping[str, Any] = top.get("settings", OBJECT)
    entry = Entry(values, "settings")
    if "extra" in entry:
        entry.numbers("extra")
    return values


def _planned(entry: Entry) -> SessionRun:
    entry.only(_names(SessionRun))
    speed = entry.get("speed", NUMBER, null=True) if "speed" in entry else None
    return SessionRun(entry.get("name", NAME), _manoeuvre(entry), speed)


def _run(entry: Entry) -> DrivenRun:
    entry.only(_names(DrivenRun))
    verdict = entry.get("verdict", OBJECT, null=True)
    if verdict is not None:
        Entry(verdict, entry.place("verdict")).get("sentence", TEXT)
    return DrivenRun(
        name=entry.get("name", NAME),
        tlog=entry.get("tlog", NAME),
        manoeuvre=None if entry.get("manoeuvre", OBJECT, null=True) is None else _manoeuvre(entry),
        state=entry.get("state", one_of(get_args(State))),
        reason=entry.get("reason", TEXT),
        span=_span(entry),
        number=entry.get("number", WHOLE),
        left_armed=entry.get("left_armed", FLAG),
        quality=tuple(stream for stream, _ in entry.each("quality", OBJECT)),
        verdict=verdict,
    )


def _span(entry: Entry) -> Span | None:
    if entry.get("span", LIST, null=True) is None:
        return None
    ends = [float(end) for end, _ in entry.each("span", NUMBER)]
    if len(ends) != 2:
        raise ValueError(f"{entry.place('span')} has {len(ends)} numbers, not a start and an end")
    return ends[0], ends[1]


def _log(entry: Entry) -> FetchedLog:
    entry.only(_names(FetchedLog))
    number, size, time_utc = (entry.get(key, WHOLE) for key in ("number", "size", "time_utc"))
    runs = tuple(label for label, _ in entry.each("runs", TEXT))
    return FetchedLog(entry.get("file", NAME), number, size, time_utc, runs)


def _listed(log: Sequence[Any], place: str) -> tuple[int, int, int]:
    if len(log) != 3:
        raise ValueError(f"{place} has {len(log)} numbers, not a log's number, size and time")
    number, size, utc = (checked(value, WHOLE, place) for value in log)
    return number, size, utc


def _manoeuvre(run: Entry) -> Manoeuvre:
    entry = Entry(run.get("manoeuvre", OBJECT), run.place("manoeuvre"))
    made = KINDS[entry.get("kind", one_of(tuple(KINDS)))]
    entry.only(_names(made))
    # a number that is missing would be driven with its default
    kinds = {field.name: WHOLE if isinstance(field.default, int) else NUMBER for field in fields(made)}
    numbers = {name: entry.get(name, kind) for name, kind in kinds.items() if name != "kind"}
    try:
        return made(**numbers)
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{run.place('manoeuvre')} cannot be driven: {error}") from None


def _names(of: type[Any]) -> tuple[str, ...]:
    return tuple(field.name for field in fields(of))
