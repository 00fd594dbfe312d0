"""The plan as rows that can be added, changed and removed; pure functions. Space comes from `design`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from firmware_params.applet_parameters import PARAMETERS, SWITCH_HIGH
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.design.demand import Space, space
from rover_sweep.errors import UsageError
from rover_sweep.manoeuvre.sweep import FIRST_DOUBLET, FIRST_SWEEPS, Manoeuvre, ThrottleSweep, parameters_of
from rover_sweep.session.content import KINDS
from rover_sweep.tui.drawn import APPLET
from rover_sweep.tui.model.state import State

SPEED = 2.0  # m/s, default of a row
FIRST_THROTTLE = 30.0  # us, of a first throttle sweep: the full one may pass the limits of the speed


@dataclass(frozen=True)
class Row:
    """A run to drive. speed [m/s]: to hold; name: kept through all changes; settles: its purpose as a
    sentence, if known."""

    manoeuvre: Manoeuvre
    speed: float = SPEED
    name: str = ""
    settles: str = ""

    @property
    def kind(self) -> str:
        """The kind, as used in names of runs."""
        return self.manoeuvre.kind.replace("_", "-")


@dataclass(frozen=True)
class Field:
    """A number of a row that can be changed in steps. form: its format."""

    name: str
    words: str
    unit: str
    step: float
    form: str = "g"


_SPEED = Field("speed", "speed to hold", "m/s", 0.2, ".1f")
_AMPLITUDE = Field("amplitude", "amplitude", "us", 10)
_SWEPT = (
    Field("w_min", "lowest frequency", "rad/s", 0.1, ".1f"),
    Field("w_max", "highest frequency", "rad/s", 1),
    Field("t_rec", "sweep duration", "s", 5),
)
_FIELDS: Mapping[str, tuple[Field, ...]] = {
    "sweep": (_AMPLITUDE, _SPEED, *_SWEPT),
    "bias_sweep": (_AMPLITUDE, Field("bias", "offset", "us", 10), _SPEED, *_SWEPT),
    "throttle": (_AMPLITUDE, _SPEED, *_SWEPT),
    "multisine": (_AMPLITUDE, _SPEED, *_SWEPT, Field("periods", "periods", "", 1)),
    "doublet": (
        _AMPLITUDE,
        _SPEED,
        Field("pulse", "step duration", "s", 0.1, ".1f"),
        Field("pause", "pause", "s", 0.5, ".1f"),
        Field("count", "number of doublets", "", 1),
    ),
}

FIRST = (
    *(Row(sweep, name=f"sweep{n}") for n, sweep in enumerate(FIRST_SWEEPS, 1)),
    Row(FIRST_DOUBLET, name="doublet1"),
)  # the default of `rover-sweep run`


def fields(row: Row) -> tuple[Field, ...]:
    """The numbers of a row that can be changed."""
    return _FIELDS[row.manoeuvre.kind]


def value(row: Row, of: Field) -> float:
    """The current value of a field."""
    return float(row.speed if of.name == "speed" else getattr(row.manoeuvre, of.name))


def new(kind: str, speed: float = SPEED) -> Row:
    """A row with default numbers."""
    return Row(ThrottleSweep(amplitude=FIRST_THROTTLE) if kind == "throttle" else KINDS[kind](), speed)


def row_with(row: Row, of: Field, number: float, limits: Mapping[str, float] | None = None) -> Row:
    """The row with a new number. UsageError if the applet would refuse it; limits: of the applet."""
    number = round(number, 3)
    if of.name == "speed":
        if not 0 < number <= 30:
            raise UsageError(f"a speed of {number:g} m/s is not possible; use 0.2 to 30")
        return replace(row, speed=number)
    kept: Any = int(number) if of.name in ("periods", "count") else number
    try:
        manoeuvre = replace(row.manoeuvre, **{of.name: kept})
    except ValueError as error:
        raise UsageError(str(error)) from error
    parameters_of(manoeuvre, **(limits or {}))
    return replace(row, manoeuvre=manoeuvre, settles="")


def with_names(rows: Iterable[Row], taken: Iterable[str]) -> tuple[Row, ...]:
    """The rows, with the first free name of sweep1, sweep2, ... for those without a name."""
    rows = tuple(rows)
    names = {*taken, *(row.name for row in rows)}
    found = []
    for row in rows:
        number = 1
        while not row.name and f"{row.kind}{number}" in names:
            number += 1
        found.append(row if row.name else replace(row, name=f"{row.kind}{number}"))
        names.add(found[-1].name)
    return tuple(found)


@dataclass(frozen=True)
class Needs:
    """Space and time needed. spaces: of each row, None without steering in the vehicle file; words: why."""

    spaces: tuple[Space | None, ...] = ()
    seconds: float = 0.0
    words: str = ""


def needs(rows: tuple[Row, ...], vehicle: Vehicle | None) -> Needs:
    """Space of each run [m] and the duration of all [s]."""
    seconds = sum(row.manoeuvre.duration for row in rows)
    if vehicle is None:
        return Needs((None,) * len(rows), seconds, "no vehicle file: the space needed is unknown")
    try:
        return Needs(tuple(space(row.manoeuvre, vehicle, row.speed) for row in rows), seconds)
    except UsageError as error:
        return Needs((None,) * len(rows), seconds, str(error).partition(";")[0])


def ground(row: Row, vehicle: Vehicle | None) -> str:
    """The space that a row needs, as part of a sentence; "" if unknown."""
    (known,) = needs((row,), vehicle).spaces
    return f", on {known.length:.0f} x {known.width:.0f} m" if known else ""


def largest(spaces: Iterable[Space | None]) -> tuple[float, float]:
    """(length, width) [m] of the space that is enough for each of them; NaN if all are unknown."""
    known = [(s.length, s.width) for s in spaces if s is not None] or [(math.nan, math.nan)]
    return max(length for length, _ in known), max(width for _, width in known)


def rows_of_plan(document: Mapping[str, Any]) -> tuple[Row, ...]:
    """Rows from the JSON of `rover-sweep plan` (`report.diagnosis.report`); one row per repeat.

    Servo tests on blocks are skipped, as nothing is driven.
    """
    rows: list[Row] = []
    settles = [str(s) for s in document.get("settles") or ()]
    for n, run in enumerate(document.get("proposal") or ()):
        if run["kind"] not in KINDS:
            continue
        numbers: dict[str, Any] = {"amplitude": float(run["amplitude_us"])}
        if run["kind"] == "bias_sweep":
            numbers["bias"] = float(run["bias_us"])
        manoeuvre = KINDS[run["kind"]](**numbers)
        row = Row(manoeuvre, float(run["speed"]), "", settles[n] if n < len(settles) else "")
        rows += [row] * int(run.get("repeat", 1))
    return tuple(rows)


# The pilot's current task, in two words and in a sentence.


_STILL = next(p.default for p in PARAMETERS if p.name == "SWP_STILL")  # s
HOLD = 4  # mode
IN_HOLD = (
    "The rover stopped and is armed: it missed this program, or the pilot chose HOLD. To drive it by hand, "
    "centre the sticks and turn the mode switch away and back to MANUAL."
)
STILL_SPEED = 0.2  # m/s, below which the applet takes the rover to stand


@dataclass(frozen=True)
class Task:
    """big: words in large letters; sentence: the details. urgent: the program waits for the pilot."""

    big: str
    sentence: str
    urgent: bool = True


def task(state: State, speed: float = float("nan")) -> Task:
    """The task in the current run. speed [m/s]: the planned one, NaN if unknown."""
    if state.aborting:
        return Task("ABORTING", "The run is ending. Switch low also ends it.")
    if state.played is not None:
        return Task(
            "REPLAY", f"A recording: nothing moves. The applet: {APPLET.get(state.applet, 'unknown')}.", False
        )
    if state.lost:
        return Task("NO LINK", f"{state.lost} Set the switch low: it stops the rover without this laptop.")
    drive = state.driving
    if state.armed and state.snapshot is not None and state.snapshot.mode == HOLD:
        return Task("IN HOLD", IN_HOLD)
    if drive is None:
        return _without_run(state)
    settings, applet = drive.settings, state.applet
    if state.wanted is not None and state.wanted.position == "low":
        return Task("SWITCH LOW", f"The run is over: throw switch {state.wanted.channel} low.")
    if applet == 0:
        return _before(state)
    left = _standstill_left(state)
    if drive.planned.manoeuvre.kind == "throttle" and settings.throttle_us is None and applet in range(2, 10):
        return _throttle_sweep(applet, f" at {speed:g} m/s" if math.isfinite(speed) else "", left)
    if applet in (1, 9) and settings.throttle_us is not None:
        return Task("WAIT", f"This program keeps the rover still and records the standstill{left}.", False)
    if applet == 1:
        return Task(
            "STAND STILL",
            f"Recording the standstill{left}: keep the rover still and the throttle at zero.",
            False,
        )
    if applet == 2:
        if settings.throttle_us is not None:
            return Task("HANDS OFF", f"This program drives, throttle {settings.throttle_us} us.", False)
        at = f" to {speed:g} m/s" if math.isfinite(speed) else ""
        return Task("DRIVE", f"Drive straight ahead and speed up{at}; then the applet starts to steer.")
    if applet in range(3, 9):
        if settings.throttle_us is not None:
            does = "moves the motor" if drive.planned.manoeuvre.kind == "throttle" else "steers"
            return Task(
                "HANDS OFF",
                f"The applet {does}, this program drives. Set the switch low to stop it without this laptop.",
                False,
            )
        return Task(
            "HOLD THROTTLE",
            "The applet steers: release the stick, keep the throttle. Set the switch low to stop.",
            False,
        )
    if applet == 9:
        return Task("STAND STILL", f"Throttle to zero and stand still: recording the standstill{left}.")
    return Task("STOPPED", "The applet has stopped; you have the steering.")


def _throttle_sweep(applet: int, at: str, left: str) -> Task:
    """The task of a pilot who steers while the applet moves the throttle."""
    if applet == 2:
        return Task("DRIVE", f"Drive straight{at} and hold the throttle stick still; the sweep then starts.")
    if applet == 9:
        return Task("ROLL OUT", f"Throttle to neutral and let it roll out, then stand still{left}.")
    return Task("YOU STEER", "The applet moves the motor: only steer, keep the throttle stick still.", False)


def _standstill_left(state: State) -> str:
    """', 2 s left' of the standstill that the applet records; '' where it is not known."""
    lasts = state.parameters.get("SWP_STILL", _STILL)
    if not lasts or not state.history or state.applet not in (1, 9):
        return ""
    now = state.history[-1].t
    began = now
    for one in reversed(state.history):
        if one.state != state.applet or (state.applet == 9 and not one.speed < STILL_SPEED):
            break
        began = one.t
    return f", {max(0.0, lasts - (now - began)):.0f} s left"


def _before(state: State) -> Task:
    drive = state.driving
    assert drive is not None
    if not state.armed:
        if drive.settings.arm:
            return Task("WAIT", "This program arms the rover. Keep clear of the wheels.", False)
        return Task("ARM", "Arm the rover in MANUAL; keep the throttle at zero.")
    if drive.settings.trigger != "pilot":
        return Task("WAIT", "This program throws the switch. Keep clear.", False)
    if state.wanted is not None:
        return Task("SWITCH HIGH", f"When the area is clear, throw switch {state.wanted.channel} high.")
    return Task("WAIT", "Writing the run's parameters to the rover.", False)


def _without_run(state: State) -> Task:
    """The task without a run of this program: switch low, or an applet that steers."""
    now = state.snapshot
    high = now is not None and now.switch > SWITCH_HIGH
    if high or (state.wanted is not None and state.wanted.position == "low"):
        return Task("SWITCH LOW", "No run is active: throw the switch low.")
    if state.under_way:
        return Task("IT STEERS", "The applet steers, but this program did not start it.")
    return Task("", "No run is under way; G drives the next one of the plan (3).", False)
