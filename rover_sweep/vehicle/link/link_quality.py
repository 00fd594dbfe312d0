"""The quality of a link, and whether a missing answer means anything.

A request needs two frames, its own and that of the answer. If frames are lost, a missing answer means
nothing until the request was repeated often enough: `LinkQuality.tries` gives how often, and
`LinkQuality.concludes` whether the link allows a conclusion at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, log

from rover_sweep.errors import LinkError

LONGEST = 8.0  # s that an answer may take: 3 s each way and the vehicle's own time
MOST_TRIES = 30
_CHANCE = 1e-3  # probability to report something as absent that exists
_POOR_LOSS, _BAD_LOSS = 0.02, 0.2  # share of the frames: spoils a response, makes every request slow
_SLOW = 1.0  # s
_FEW = 10  # frames: fewer give no estimate of the lost share
_HASTE = 0.5  # s after which a request is repeated on a link that loses frames, if it is not slow too
_MARGIN, _STRETCH = 0.15, 1.25  # s, and factor of the latency: the latency varies
ADVICE = "move the antennas, go closer, lower the stream rates, or use USB"


class BadLink(LinkError):
    """The link is too poor for a conclusion; the sentence gives the measured quality."""


@dataclass(frozen=True)
class LinkQuality:
    """Measured over the last `seconds` s, on `frames` whole frames of the vehicle.

    All shares are 0..1. lost: of its frames that did not arrive whole; corrupted: that arrived damaged (part
    of lost); duplicated: of the whole frames that had arrived before. answered: of the requests that the
    vehicle can answer. latency: from a request to its answer [s], None while unknown. silence, unanswered:
    time since the last frame, and since the last answer to a request [s].
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
        """Number of requests after which no answer on one of `of` items means that it is absent."""
        if self.passed >= 1 - _POOR_LOSS:
            return least
        needed = log(_CHANCE / max(of, 1)) / log(max(1 - self.passed, 1e-9))
        return min(max(least, ceil(needed)), MOST_TRIES)

    def concludes(self, tries: int, of: int = 1) -> bool:
        """Whether no answer on one of `of` items after `tries` requests means that it is absent."""
        return self.tries(1, of) <= tries and of * (1 - self.passed) ** tries <= _CHANCE

    def wait(self, usual: float) -> float:
        """The time to wait [s] for an answer that takes at most `usual` s on a good link."""
        patience = usual if self.lost < _POOR_LOSS else min(usual, _HASTE)
        return max(patience, _MARGIN + _STRETCH * min(self.latency or 0.0, LONGEST))

    @property
    def poor(self) -> bool:
        """Whether the link loses frames or answers, or answers slowly."""
        return self._loses or self.answered < 1 - _BAD_LOSS or (self.latency or 0.0) > _SLOW

    @property
    def bad(self) -> bool:
        """Whether the link is too poor to start a run over it."""
        return (self._loses and self.lost > _BAD_LOSS) or (self.latency or 0.0) > _SLOW

    @property
    def _loses(self) -> bool:
        return self.frames >= _FEW and self.lost > _POOR_LOSS

    @property
    def words(self) -> str:
        """The measured fault of the link and the remedy; '' if the link is good."""
        if not self.poor:
            return ""
        measured = f"measured over {max(self.seconds, 1):.0f} s"
        return f"{' and '.join(self._faults())} ({measured}); {ADVICE}"

    def _faults(self) -> list[str]:
        faults = []
        if self._loses:
            damaged = f", {self.corrupted:.0%} by damage" if self.corrupted >= 0.01 else ""
            faults.append(f"the link loses {self.lost:.0%} of the frames{damaged}")
        if self.answered < (1 - self.lost) ** 2 - _BAD_LOSS:  # the uplink is worse than the downlink
            faults.append(f"{1 - self.answered:.0%} of the requests get no answer")
        if (self.latency or 0.0) > _SLOW:
            faults.append(f"an answer takes {self.latency:.1f} s")
        return faults or [f"{1 - self.answered:.0%} of the requests get no answer"]
