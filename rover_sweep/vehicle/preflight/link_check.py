"""Check of the link: lost or damaged frames, and the time to an answer."""

from __future__ import annotations

from rover_sweep.vehicle.link.link_quality import ADVICE, LinkQuality
from rover_sweep.vehicle.preflight.item import Check, Remedy
from rover_sweep.vehicle.preflight.observed import Observation

_LEAST_FRAMES = 50  # fewer give too rough an estimate of the lost share


def link(observed: Observation) -> Check:
    """Loss from the sequence numbers of the frames, and the time from a request to its answer."""
    quality = observed.link
    if quality is None or quality.frames < _LEAST_FRAMES:
        return Check("link", "unknown", "not measured", "too few frames arrived to measure the loss")
    value = _value(quality)
    if not quality.poor:
        return Check("link", "good", value, f"measured on {quality.frames} frames in {quality.seconds:.0f} s")
    hand = Remedy(ADVICE, by_hand=True)
    return Check("link", "bad" if quality.bad else "doubtful", value, quality.words, hand)


def _value(quality: LinkQuality) -> str:
    lost = f"{quality.lost:.1%} lost" if quality.lost else "nothing lost"
    answers = "" if quality.latency is None else f", answers in {1000 * quality.latency:.0f} ms"
    return lost + answers
