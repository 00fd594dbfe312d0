"""What must hold whatever happens to link, laptop and rover, as sentences on what does not.

    assert broken(outcome) == []

Nothing that moves the rover is sent more than `MAY_BE_LATE` after it was heard. When the laptop cannot reach
the vehicle, its last override holds for RC_OVERRIDE_TIME, which a run sets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from virtual_run import Outcome

from rover_sweep.errors import RoverSweepError

MAY_BE_LATE = 1.0  # s
WINDS_DOWN = 0.4  # s that the throttle output takes to trim (MOT_SLEWRATE), and a message in flight
OVERRIDE_HOLDS = 1.0  # s, RC_OVERRIDE_TIME
WAITING_LIMIT = 15.0  # s that the throttle is held for, waiting for speed
WAITING, STEERED, NOT_DRIVEN = (2,), (3, 4, 5, 6, 7, 8), (0, 1, 9, 10)  # SWP_ST


def broken(outcome: Outcome, manoeuvre_s: float = 12.0) -> list[str]:
    """A sentence for each promise that the drive code did not keep. manoeuvre_s: length of the override."""
    return [sentence for promise in PROMISES for sentence in promise(outcome, manoeuvre_s)]


def _ended(outcome: Outcome, manoeuvre_s: float) -> Iterator[str]:
    if outcome.overran:
        yield f"it did not end: {outcome.error}"
    if isinstance(outcome.error, RoverSweepError) and not str(outcome.error):
        yield f"{type(outcome.error).__name__} says nothing"


def _asked(outcome: Outcome, manoeuvre_s: float) -> Iterator[str]:
    if outcome.unasked:
        yield f"the applet began runs {[n for _, n in outcome.record.begun]}, {outcome.asked} asked for"
    if outcome.again_high():
        yield "the switch was sent high again"


def _heard(outcome: Outcome, manoeuvre_s: float) -> Iterator[str]:
    if (late := outcome.sent_late()) > MAY_BE_LATE:
        yield f"throttle was sent {late:.2f} s after the vehicle was last heard"
    if (late := outcome.sent_late(lambda sent: sent.state_heard)) > MAY_BE_LATE:
        yield f"throttle was sent {late:.2f} s after the applet last told its state"
    if (late := max((sent.heard for sent in outcome.record.sent if sent.high), default=0.0)) > MAY_BE_LATE:
        yield f"the switch was sent high {late:.2f} s after the vehicle was last heard"
    if (late := outcome.record.driven_unheard()) > MAY_BE_LATE + WINDS_DOWN:
        yield f"the rover drove {late:.2f} s after it was last heard, though it could be stopped"


def _within_phases(outcome: Outcome, manoeuvre_s: float) -> Iterator[str]:
    waited = outcome.record.seconds_in(WAITING)
    if waited > WAITING_LIMIT + MAY_BE_LATE + WINDS_DOWN + OVERRIDE_HOLDS:
        yield f"driven for {waited:.1f} s while waiting for speed"
    steered = outcome.record.seconds_in(STEERED)
    if steered > manoeuvre_s + MAY_BE_LATE + WINDS_DOWN + OVERRIDE_HOLDS:
        yield f"driven for {steered:.1f} s in a manoeuvre of {manoeuvre_s:.1f} s"
    beyond = outcome.record.seconds_in(NOT_DRIVEN)
    if beyond > MAY_BE_LATE + WINDS_DOWN + OVERRIDE_HOLDS:
        yield f"driven for {beyond:.1f} s outside the manoeuvre"


def _reported(outcome: Outcome, manoeuvre_s: float) -> Iterator[str]:
    if wrong := outcome.misreported():
        yield wrong
    if outcome.left_armed and not outcome.killed and "armed" not in outcome.said:
        yield f"it ended with the rover armed and does not say so: {outcome.said!r}"


PROMISES: tuple[Callable[[Outcome, float], Iterator[str]], ...] = (
    _ended,
    _asked,
    _heard,
    _within_phases,
    _reported,
)
