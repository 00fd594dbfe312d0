"""The pilot's current task, in two words and in a sentence."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from firmware_params.applet_parameters import PARAMETERS, SWITCH_HIGH
from rover_sweep.tui.drawn.labels import APPLET
from rover_sweep.tui.model.state import State

_STILL = next(p.default for p in PARAMETERS if p.name == "SWP_STILL")  # s
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
    if drive is None:
        return _without_run(state)
    settings, applet = drive.settings, state.applet
    if state.wanted is not None and state.wanted.position == "low":
        return Task("SWITCH LOW", f"The run is over: throw switch {state.wanted.channel} low.")
    if applet == 0:
        return _before(state)
    left = _standstill_left(state)
    if drive.planned.manoeuvre.kind == "throttle" and settings.throttle_us is None and applet in range(2, 10):
        return _throttle_sweep(applet, f" at {speed:g} m/s" if isfinite(speed) else "", left)
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
        at = f" to {speed:g} m/s" if isfinite(speed) else ""
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
