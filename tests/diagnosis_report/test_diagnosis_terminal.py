"""The terminal's text at 80 columns."""

from __future__ import annotations

import io
from dataclasses import replace

import pytest
from fabricated_diagnoses import ALL, EXPLAINED, PARTLY
from fabricated_plans import PLAN
from rich.console import Console

from rover_sweep.diagnosis.result import Diagnosis, Unseen, UpperBound
from rover_sweep.report.diagnosis.report import diagnosis_report, plan_report
from rover_sweep.report.document import Document
from rover_sweep.report.on_terminal import on_terminal
from rover_sweep.report.wording import sentence

EXPECTED = """\
PARTLY EXPLAINED
Play in the steering and tyre relaxation explain most of it, something in p
remains.

On held-out runs
run   J_rms before  after  TIC before  after  share removed
run4          4.21   1.01        0.21  0.055           89 %
J_rms in deg/s and ft/s², with the noise; TIC 0 (perfect) to 1. Share removed:
of the squared residual above the noise floor, the only part that a model can
explain.

Where simulation and recording differ
     where         rad/s  residual / noise
r    120 us      0.5–3.1             6.3 ×
a_y  throughout     4–14             4.1 ×

Backlash of the linkage (steering_backlash)
The steering has play of 0.017 rad from end to end (0.95 deg at the road
wheels). It explains 87 % of the squared residual above the noise on run4
(J_rms, with the noise: 4.21 without it, 1.12 with it).

                               value       90 % interval  unit
b  half the gap of the play  0.00830  0.00710 to 0.00940   rad

These runs cannot separate it from: deadband of the steering (steering_deadband,
31 %).
To separate them: a servo test on blocks: 40 us at 0.5 rad/s, wheels off the
ground.
Chi-squared falls by 412 (by chance: at most 21.4).

Relaxation length of the tyres (tyre_relaxation)
Side force builds up over 0.31 m of rolling. It explains 12 % of the squared
residual above the noise on run4 (J_rms, with the noise: 1.12 without it, 1.01
with it).

                                      value  90 % interval  unit
sigma  relaxation length, both axles  0.310     from 0.240     m

Chi-squared falls by 55.0 (by chance: at most 18.0).

Part that no candidate explains
where       p
size        2.4 × the noise
depends on  phi and p

The roll rate keeps 2.4 noise floors that the roll state predicts.
Fitted law: -0.31 phi^3 (explains 62 % of it on held-out data).
"""
EXPECTED_PLAN = """\
These runs cannot tell tyre relaxation from a delay, nor see the rate limit of
the servo.
Two more runs would.

These runs
         amplitude, us  speed, m/s  heading, deg  times
sweep              150         2.4           any      2
doublet            150         2.4            90      1

Detectable sizes
effect                 detectable  matters   unit
steering_backlash  b       0.0021   0.0030    rad
tyre_saturation    mu        0.62     0.90      -
servo_rate_limit   R            –        –  rad/s
detectable: size from which a diagnosis is expected to name the effect with
80 %. matters: smaller is normal tolerance.

Effects that these runs cannot separate
true             explains it as well  probability
tyre_relaxation  transport_delay             48 %
tyre_saturation  load_transfer               31 %

Effects that these runs cannot detect
effect       why
cross_slope  one heading

Additional runs to drive
                     amplitude, us  speed, m/s  heading, deg  times
sweep                          240         2.4           any      1
sweep about a bias  100 about +150         1.6           180      1

Sweep of 240 us at 2.4 m/s: 0.5 bit of information; detects and separates
tyre_relaxation.
Sweep about a bias: 0.1 bit of information.

Effects still not separated with them
true             explains it as well  probability
tyre_saturation  load_transfer               23 %

No run is proposed beyond 3.9 m/s^2 of lateral acceleration.
"""


def shown(what: Document, width: int = 80) -> str:
    out = io.StringIO()
    Console(file=out, width=width).print(on_terminal(what))
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def told(found: Diagnosis) -> str:
    return shown(diagnosis_report(found))


def test_the_summary_is_this_text() -> None:
    assert told(PARTLY) == EXPECTED


def test_the_plan_is_this_text() -> None:
    assert shown(plan_report(PLAN)) == EXPECTED_PLAN


SENTENCES = {
    "play in the steering": "Play in the steering.",
    "a_y differs": "a_y differs.",
    "r lags!": "r lags!",
    "run1 has no p": "run1 has no p.",
    "a lag": "A lag.",
    "C is 3": "C is 3.",
    "": "",
}


def test_a_sentence_begins_large_unless_it_begins_with_a_name() -> None:
    assert {text: sentence(text) for text in SENTENCES} == SENTENCES


@pytest.mark.parametrize("verdict", ALL)
def test_nothing_is_wider_than_the_terminal(verdict: str) -> None:
    text = told(ALL[verdict])
    assert max(map(len, text.splitlines())) <= 80
    assert text.startswith(verdict.upper())
    assert "…" not in text  # nothing cut off either


def test_a_long_name_leaves_the_numbers_whole_and_no_share_exceeds_all() -> None:
    name = "2025-05-01-afternoon/run4_doublet_150us_gravel"
    text = told(replace(EXPLAINED, held_out=(replace(EXPLAINED.held_out[0], run=name),)))
    assert "J_rms before  after  TIC before  after  share removed" in text
    assert "…n4_doublet_150us_gravel" in text and "87 %" in text
    first = EXPLAINED.findings[0]
    over = replace(first, held_out=tuple(replace(h, share_removed=1.14) for h in first.held_out))
    text = told(replace(EXPLAINED, findings=(over,)))
    assert "114" not in text and "explains 100 % of the squared residual above the noise" in text


def test_what_could_still_hide_is_in_the_answer() -> None:
    bounded = (
        Unseen("roll_steer", "", {"e": UpperBound("-", -0.42, 0.30, 0.04)}, 0.08),
        Unseen("imu_offset", "", {k: UpperBound("m", -0.03, 0.03, 0.012) for k in ("x", "z")}, 0.06),
        Unseen("servo_rate_limit", "", {"R": UpperBound("rad/s", 38.0, None, 4.0)}, 0.01, material=False),
        Unseen("sensor_filter", "", {"gyro_hz": UpperBound("Hz", 23.0, None, 29.0)}, 0.09),
        Unseen("cross_slope", "", {"b": UpperBound("-", 0.0, 0.03, 0.02)}, 0.02),  # no turn would show it
    )
    slope = Unseen("cross_slope", "", {"slope": UpperBound("rad", 0.0, 0.05, 0.03)}, change=0.1)
    assert "the ground slopes (up to 0.050 rad)" in told(replace(EXPLAINED, cannot_see=(slope,)))
    answer = " ".join(told(replace(EXPLAINED, cannot_see=bounded)).split())
    assert (
        "Could still hide (95 %): an unknown sensor filter (at least 23 Hz), roll steer of the front axle "
        "(-0.42 to 0.30), the IMU is not where the vehicle file says (x ±0.030 m, z ±0.030 m)." in answer
    )
    assert "servo_rate_limit" not in answer and "cannot detect" not in answer


def test_the_form_of_a_law_is_said_once() -> None:
    said = "saturation of the tyres (form: brush), mu = 0.7"
    one = replace(EXPLAINED.findings[0], effect="tyre_saturation", sentence=said, form="brush")
    text = told(replace(EXPLAINED, findings=(one,)))
    assert text.count("brush") == 1 and "tyre_saturation/brush" not in text


def test_the_headline_is_not_repeated_under_unknown() -> None:
    assert PARTLY.unknown is not None
    left = replace(PARTLY.unknown, sentence="p still differs; no candidate explains it; it has no pattern")
    text = shown(
        diagnosis_report(replace(PARTLY, sentence="play explains a part, but p still differs", unknown=left))
    )
    assert text.count("still differs") == 1 and text.count("No candidate explains it") == 1
