"""Check of the link: frames that are lost or damaged, and how long an answer takes."""

from __future__ import annotations

from rover_sweep.vehicle.link.link_quality import ADVICE, LinkQuality
from rover_sweep.vehicle.preflight.item import Check, Remedy
from rover_sweep.vehicle.preflight.observed import Observation

_GUESSED = 50  # frames: fewer tell the lost share too roughly


def link(seen: Observation) -> Check:
    """Sequence numbers of the frames that came, and the time from a request to its answer."""
    quality = seen.link
    if quality is None or quality.frames < _GUESSED:
        return Check("link", "unknown", "not measured", "too few frames came to tell how many are lost")
    told = _told(quality)
    if not quality.poor:
        return Check("link", "good", told, f"measured on {quality.frames} frames in {quality.seconds:.0f} s")
    hand = Remedy(ADVICE, by_hand=True)
    return Check("link", "bad" if quality.bad else "doubtful", told, quality.words, hand)


def _told(quality: LinkQuality) -> str:
    lost = f"{quality.lost:.1%} lost" if quality.lost else "nothing lost"
    answers = "" if quality.latency is None else f", answers in {1000 * quality.latency:.0f} ms"
    return lost + answers
