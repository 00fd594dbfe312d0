"""How good a link is, as a value, and what may be concluded over it.

A request needs its frame and that of the answer. Where frames are lost, silence on a parameter says nothing
on the vehicle until the request was repeated often enough: `LinkQuality.tries` says how often, and
`LinkQuality.concludes` whether the link allows it at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, log

from rover_sweep.errors import LinkError

LONGEST = 8.0  # s that an answer may take: 3 s each way and the vehicle's own time
MOST_TRIES = 30
_CHANCE = 1e-3  # that something is called absent which is there
_POOR_LOSS, _BAD_LOSS = 0.02, 0.2  # share of the frames: spoils a response, makes every request slow
_SLOW = 1.0  # s
_FEW = 10  # frames: fewer say nothing on the share that is lost
_HASTE = 0.5  # s after which a request is repeated on a link that loses frames, if it is not slow too
_MARGIN, _STRETCH = 0.15, 1.25  # s, and factor of the latency: one answer is later than another
ADVICE = "move the antennas, go closer, lower the stream rates, or use USB"


class BadLink(LinkError):
    """Nothing can be concluded over this link; the sentence says what was measured."""


@dataclass(frozen=True)
class LinkQuality:
    """Measured over the last `seconds` s, on `frames` whole frames of the vehicle.

    lost: share of its frames that did not arrive whole; corrupted: share that arrived damaged (part of lost);
    duplicated: share of the whole frames that had arrived before. answered: share of the requests answered,
    of those that the vehicle can answer. latency: s from a request to its answer, None while unknown.
    silence, unanswered: s since the last frame and since the last answer to a request.
    """

    seconds: float = 0.0
    frames: int = 0
    lost: float = 0.0
    corrupted: float = 0.0
    duplicated: float = 0.0
    answered: float = 1.0
    latency: float | None = None
    silence: float = 0.0
    unanswered: float = 0.0

    @property
    def passed(self) -> float:
        """Estimated probability that a request and its answer both arrive."""
        return min((1 - self.lost) ** 2, self.answered)

    def tries(self, least: int, of: int = 1) -> int:
        """How often to ask before silence on one of `of` things means that it is absent."""
        if self.passed >= 1 - _POOR_LOSS:
            return least
        needed = log(_CHANCE / max(of, 1)) / log(max(1 - self.passed, 1e-9))
        return min(max(least, ceil(needed)), MOST_TRIES)

    def concludes(self, tries: int, of: int = 1) -> bool:
        """Whether silence on one of `of` things after so many requests means that it is absent."""
        return self.tries(1, of) <= tries and of * (1 - self.passed) ** tries <= _CHANCE

    def wait(self, usual: float) -> float:
        """s to wait for an answer that takes at most `usual` s on a good link."""
        patience = usual if self.lost < _POOR_LOSS else min(usual, _HASTE)
        return max(patience, _MARGIN + _STRETCH * min(self.latency or 0.0, LONGEST))

    @property
    def poor(self) -> bool:
        """Whether the link spoils something: frames lost or requests in vain, or slow answers."""
        return self._loses or self.answered < 1 - _BAD_LOSS or (self.latency or 0.0) > _SLOW

    @property
    def bad(self) -> bool:
        """Whether it is so poor that a run should not be begun over it."""
        return (self._loses and self.lost > _BAD_LOSS) or (self.latency or 0.0) > _SLOW

    @property
    def _loses(self) -> bool:
        return self.frames >= _FEW and self.lost > _POOR_LOSS

    @property
    def words(self) -> str:
        """What is wrong with the link, measured, and what to do; '' where it is good."""
        if not self.poor:
            return ""
        measured = f"measured over {max(self.seconds, 1):.0f} s"
        return f"{' and '.join(self._faults())} ({measured}); {ADVICE}"

    def _faults(self) -> list[str]:
        faults = []
        if self._loses:
            damaged = f", {self.corrupted:.0%} by damage" if self.corrupted >= 0.01 else ""
            faults.append(f"the link loses {self.lost:.0%} of the frames{damaged}")
        if self.answered < (1 - self.lost) ** 2 - _BAD_LOSS:  # the way there is worse than the way back
            faults.append(f"{1 - self.answered:.0%} of the requests stay without an answer")
        if (self.latency or 0.0) > _SLOW:
            faults.append(f"an answer takes {self.latency:.1f} s")
        return faults or [f"{1 - self.answered:.0%} of the requests stay without an answer"]
