"""Whether a finding is a verdict, and how much it matters: its share of the residual, its turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.held_out.turn_impact import Turn
from rover_sweep.diagnosis.result import Diagnosis, Finding, HeldOut

LITTLE = 0.05  # relative drop of J_rms on held-out runs, below which an effect hardly matters
LONGEST = 0.4  # s, largest delay that is tried
LEAST_CHANGE = 0.02  # of a channel in the runs, rms over rms, that matters where no turn shows it
LEAST_DELAY, LEAST_GAIN = 0.005, 0.01  # s, relative: smaller changes of a turn are not stated


@dataclass(frozen=True)
class TurnChange:
    """What the findings together do to the yaw rate of a run, against the baseline.

    delay [s]: later start of a turn; gain: relative change of the yaw rate; distance [m]: delay at `speed`.
    """

    delay: float
    gain: float
    speed: float

    @property
    def distance(self) -> float:
        return self.delay * self.speed


def why_it_does_not_matter(absent: bool, turn: Turn | None = None, change: float = 1.0) -> str:
    """Why a probable effect is listed as present and not named, "" where it matters.

    absent: the 90 % intervals of its size hold no effect at all. turn: what it does to one, None where it has
    no part in it. change: of a channel in the runs, rms over rms.
    """
    if absent:
        return "the 90 % interval of its size includes zero"
    if turn is not None and not turn.visible and change < LEAST_CHANGE:
        return "it changes no turn visibly"
    return ""


def hardly_matters(held_out: Sequence[HeldOut]) -> bool:
    """True where J_rms falls by less than `LITTLE` on every held-out run."""
    return bool(held_out) and all(h.before.j_rms - h.after.j_rms < LITTLE * h.before.j_rms for h in held_out)


def importance_words(f: Finding) -> str:
    """A sentence with the share of the held-out residual that the effect explains, "" without such runs."""
    if not f.held_out:
        return ""
    best = max(f.held_out, key=lambda h: h.share_removed if h.share_removed is not None else -np.inf)
    share = "" if best.share_removed is None else f"{100 * min(best.share_removed, 1.0):.0f} % of "
    fall = f"J_rms, with the noise: {best.before.j_rms:.2f} without it, {best.after.j_rms:.2f} with it"
    if best.share_removed is not None and best.share_removed <= 0:
        return f"It explains nothing of the residual above the noise on {best.run} ({fall})."
    words = f"It explains {share or 'little of '}the squared residual above the noise on {best.run} ({fall})"
    return f"{words}: it hardly matters, no repair is needed." if hardly_matters(f.held_out) else f"{words}."


def turn_change(found: Diagnosis) -> TurnChange | None:
    """The change of a turn by all findings, from the simulated yaw rate of the first run; None without it."""
    overlay = next((o for o in found.overlays if o.channel == "r"), None)
    if overlay is None or not found.findings or overlay.t.size < 10:
        return None
    speed = found.model.speed if found.model else 0.0
    return TurnChange(*_delay_and_gain(overlay.t, overlay.before, overlay.after), speed)


def turn_words(found: Diagnosis) -> str:
    """What the findings do to a turn, as a sentence in plain figures; "" where it is not known.

    "" too where a finding says so itself: that turn is simulated with the same parameters, but this change is
    against a model that was fitted without the findings, and the two would seem to contradict each other.
    """
    change = turn_change(found)
    if change is None or any(f.turn for f in found.findings):
        return ""
    who = "It" if len(found.findings) == 1 else "Together they"
    s = "s" if len(found.findings) == 1 else ""
    parts = []
    if abs(change.delay) >= LEAST_DELAY:
        late = "later" if change.delay > 0 else "earlier"
        at = (
            f" (at {change.speed:.1f} m/s, {abs(change.distance):.2f} m along the path)"
            if change.speed
            else ""
        )
        parts.append(f"start{s} each turn {abs(change.delay):.2f} s {late}{at}")
    if abs(change.gain) >= LEAST_GAIN:
        more = "more" if change.gain > 0 else "less"
        parts.append(f"turn{s} the rover {100 * abs(change.gain):.0f} % {more}")
    if not parts:
        return (
            f"{who} change{s} a turn by less than {1000 * LEAST_DELAY:.0f} ms and {100 * LEAST_GAIN:.0f} %."
        )
    return f"{who} {' and '.join(parts)} than the model without."


def _delay_and_gain(t: Array, before: Array, after: Array) -> tuple[float, float]:
    """(delay [s], relative change) that turn `before` into `after`, by least squares."""
    a, b = after - np.mean(after), before - np.mean(before)
    delays = np.linspace(-LONGEST, LONGEST, 801)
    moved = [np.interp(t - d, t, b) for d in delays]
    power = [float(m @ m) for m in moved]
    gains = [float(m @ a) / p if p > 0 else 0.0 for m, p in zip(moved, power, strict=True)]
    errors = [float(np.sum((a - g * m) ** 2)) for g, m in zip(gains, moved, strict=True)]
    k = int(np.argmin(errors))
    return float(delays[k]), gains[k] - 1.0
