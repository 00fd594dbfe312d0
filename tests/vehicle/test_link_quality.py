"""What is measured on a link, and what may be concluded over it."""

from __future__ import annotations

import random

import pytest

from rover_sweep.vehicle.link.inbox import MOST_TRIES, LinkMeter, LinkQuality, Sequence


def _taken(numbers: list[int]) -> tuple[int, int]:
    """(lost, duplicated)"""
    sequence = Sequence()
    results = [sequence.take(number) for number in numbers]
    return sum(lost for lost, _ in results), sum(again for _, again in results)


@pytest.mark.parametrize(
    ("numbers", "lost", "duplicated"),
    [
        ([254, 255, 0, 1], 0, 0),
        ([254, 1, 2], 2, 0),
        ([5, 5, 6, 6, 7], 0, 2),
        ([5, 7, 6, 8], 0, 0),
        ([5, 8, 6, 9, 6], 1, 1),
        ([250, 3, 255, 4], 7, 0),
    ],
)
def test_sequence_numbers(numbers: list[int], lost: int, duplicated: int) -> None:
    assert _taken(numbers) == (lost, duplicated)


@pytest.mark.parametrize("loss", [0.05, 0.2, 0.5])
def test_the_lost_share_is_that_of_the_link(loss: float) -> None:
    chance, meter = random.Random(3), LinkMeter()
    for number in range(3000):
        if chance.random() >= loss:
            meter.frame(number % 256, number * 0.01)
    assert meter.quality(30.0).lost == pytest.approx(loss, abs=0.03)


def test_damaged_frames_are_among_the_lost() -> None:
    meter = LinkMeter()
    for number in range(200):
        if number % 10 == 5:
            meter.damaged(number * 0.1)
        else:
            meter.frame(number, number * 0.1)
    quality = meter.quality(20.0)
    assert quality.lost == quality.corrupted == pytest.approx(0.1)
    assert "the link loses 10% of the frames, 10% by damage" in quality.words


def test_what_was_long_ago_is_forgotten() -> None:
    meter = LinkMeter()
    for number in range(0, 400, 2):
        meter.frame(number % 256, number * 0.05)
    assert meter.quality(20.0).lost == pytest.approx(0.5, abs=0.01)
    for number in range(400, 4000):
        meter.frame(number % 256, 20.0 + (number - 400) * 0.01)
    assert meter.quality(56.0).lost == 0.0


def test_a_reboot_loses_no_frames() -> None:
    meter = LinkMeter()
    for number in (100, 101, 102):
        meter.frame(number, 1.0)
    meter.restart()
    for number in (0, 1, 2):
        meter.frame(number, 4.0)
    assert meter.quality(5.0).lost == 0.0


def test_latency_is_from_a_request_to_its_answer() -> None:
    meter = LinkMeter()
    assert meter.latency is None
    meter.asked("a", 0.0)
    meter.answered("b", 1.0)
    assert meter.latency is None
    meter.answered("a", 2.0)
    assert meter.latency == 2.0
    meter.answered("a", 9.0)  # unasked
    assert meter.latency == 2.0


def test_lost_answers_do_not_look_slow() -> None:
    """Each second request is lost, and repeated after 1 s."""
    meter, now = LinkMeter(), 0.0
    for n in range(40):
        meter.asked(n, now)
        if n % 2:
            meter.asked(n, now := now + 1.0)
        meter.answered(n, now := now + 0.1)
    assert meter.latency == pytest.approx(0.1)
    assert meter.quality(now).answered == pytest.approx(2 / 3, abs=0.05)


def test_a_link_that_becomes_slow_is_noticed() -> None:
    meter, now = LinkMeter(), 0.0
    for n in range(5):
        meter.asked(n, now)
        meter.answered(n, now := now + 0.05)
    for n in range(5, 12):
        for _ in range(3):
            meter.asked(n, now)
            now += 1.5
        meter.answered(n, now - 0.5)
    assert meter.latency == pytest.approx(4.0)


def test_a_good_link_is_asked_as_often_as_before() -> None:
    good = LinkQuality(frames=1000, latency=0.1)
    assert good.tries(3, 40) == 3 and good.wait(1.0) == 1.0 and good.concludes(3, 40)
    assert good.words == "" and not good.poor


def test_a_link_that_loses_is_asked_more_often_until_it_is_too_bad() -> None:
    tries = [LinkQuality(frames=1000, lost=lost).tries(3, 40) for lost in (0.05, 0.2, 0.4, 0.7)]
    assert tries == sorted(tries) and 3 < tries[1] < tries[2] < MOST_TRIES == tries[3]
    assert LinkQuality(frames=1000, lost=0.2).concludes(tries[1], 40)
    assert not LinkQuality(frames=1000, lost=0.2).concludes(3, 40)
    assert not LinkQuality(frames=1000, lost=0.7).concludes(MOST_TRIES, 40)


def test_a_slow_link_is_waited_for_up_to_a_bound() -> None:
    assert 4.0 < LinkQuality(latency=4.0).wait(1.0) < 6.0
    assert LinkQuality(latency=60.0).wait(1.0) < 12.0


@pytest.mark.parametrize(
    ("quality", "words"),
    [
        (
            LinkQuality(seconds=12, frames=300, lost=0.52),
            "the link loses 52% of the frames (measured over 12 s); move the antennas",
        ),
        (LinkQuality(seconds=12, frames=300, latency=4.2), "an answer takes 4.2 s (measured over 12 s)"),
        (LinkQuality(seconds=9, frames=300, answered=0.4), "60% of the requests get no answer"),
        (
            LinkQuality(seconds=9, frames=300, lost=0.3, latency=3.0),
            "the link loses 30% of the frames and an answer takes 3.0 s",
        ),
        (LinkQuality(seconds=3, frames=2, lost=0.5), ""),
    ],
)
def test_words(quality: LinkQuality, words: str) -> None:
    assert quality.words.startswith(words) and bool(quality.words) == bool(words)


@pytest.mark.parametrize("forgotten", [True, False])
def test_what_the_vehicle_could_not_answer_yet_says_nothing_of_the_link(forgotten: bool) -> None:
    """An applet's parameter is asked for until the applet runs."""
    meter = LinkMeter()
    for n in range(300):
        meter.frame(n % 256, n * 0.05)
    for n in range(12):
        meter.asked("SWP_ENABLE", 5.0 + 0.5 * n)
        if forgotten and n < 11:
            meter.forget("SWP_ENABLE")
    meter.answered("SWP_ENABLE", 10.51)
    assert bool(meter.quality(15.0).poor) is not forgotten
