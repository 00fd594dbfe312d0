"""What the person with the radio has to do now, in two words and in a sentence."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from rover_sweep.tui.drawn.labels import APPLET
from rover_sweep.tui.model.state import State

SWITCH_HIGH = 1800  # us, above which the firmware reads high


@dataclass(frozen=True)
class Task:
    """big: the words seen from afar; sentence: the rest. urgent: somebody is being waited for."""

    big: str
    sentence: str
    urgent: bool = True


def task(state: State, speed: float = float("nan")) -> Task:
    """Of the run under way; speed [m/s]: at which it is planned."""
    if state.aborting:
        return Task("ABORTING", "The run is being ended. Switch low ends it as well.")
    if state.played is not None:
        return Task(
            "PLAYED", f"A recording: nothing moves. The applet: {APPLET.get(state.applet, 'unknown')}.", False
        )
    if state.lost:
        return Task("NO LINK", f"{state.lost} The switch low stops the rover without this laptop.")
    drive = state.driving
    if drive is None:
        return _let_go(state)
    settings, applet = drive.settings, state.applet
    if state.wanted is not None and state.wanted.position == "low":
        return Task("SWITCH LOW", f"The run is over: throw switch {state.wanted.channel} low.")
    if applet == 0:
        return _before(state)
    if applet in (1, 9) and settings.throttle_us is not None:
        return Task("WAIT", "This program keeps the rover still: the standstill is being recorded.", False)
    if applet == 1:
        return Task(
            "STAND STILL", "The rover stands: the standstill is being recorded. Throttle at zero.", False
        )
    if applet == 2:
        if settings.throttle_us is not None:
            return Task("HANDS OFF", f"This program drives, throttle {settings.throttle_us} us.", False)
        at = f" to {speed:g} m/s" if isfinite(speed) else ""
        return Task("DRIVE", f"Drive straight ahead and speed up{at}; the steering begins by itself.")
    if applet in range(3, 9):
        if settings.throttle_us is not None:
            return Task("HANDS OFF", "It steers and drives. Switch low stops it without this laptop.", False)
        return Task(
            "HOLD THROTTLE", "It steers: leave the stick, hold the throttle. Switch low stops it.", False
        )
    if applet == 9:
        return Task("STAND STILL", "Throttle to zero and stand: the standstill is being recorded.")
    return Task("STOPPED", "The applet has stopped; steering is yours.")


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
        return Task("SWITCH HIGH", f"When the ground is free, throw switch {state.wanted.channel} high.")
    return Task("WAIT", "The run is being written to the rover.", False)


def _let_go(state: State) -> Task:
    """No run of ours: is anything left to do?"""
    now = state.snapshot
    high = now is not None and now.switch > SWITCH_HIGH
    if high or (state.wanted is not None and state.wanted.position == "low"):
        return Task("SWITCH LOW", "No run is under way: throw the switch low.")
    if state.under_way:
        return Task("IT STEERS", "The applet steers, and this program did not ask for it.")
    return Task("", "No run is under way. Choose one in the plan.", False)
