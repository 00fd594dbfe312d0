"""What is proposed for the nominal rover, and when nothing is."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from firmware_params.param_files import parse
from rover_sweep.gains import proposal as proposals
from rover_sweep.gains import tuning
from rover_sweep.gains.controller import feedback_response
from rover_sweep.gains.gains_json import param_text
from rover_sweep.gains.identified import from_identification
from rover_sweep.gains.proposal import Proposal, family_of, propose_gains
from rover_sweep.gains.steering_chain import autopilot, sampled_plant
from rover_sweep.gains.tuning import (
    GAIN_MARGIN_DB,
    PHASE_MARGIN_DEG,
    design_gains,
    frequencies,
    margins,
    unbounded,
    why_none,
)

AS_RECORDED = {"SCHED_LOOP_RATE": 100.0, "INS_GYRO_FILTER": 20.0}
LOOP = autopilot(AS_RECORDED)
TRUE_STEADY = 2.5 / 0.391  # r/delta of the nominal plant at 2.5 m/s, which hardly understeers


def test_the_steady_turn_rate_is_the_rovers(proposal: Proposal):
    assert proposal.steady_gain == pytest.approx(TRUE_STEADY, rel=0.03)
    held = proposal.feed_forwards[2.5]
    assert held == pytest.approx(1 / (TRUE_STEADY * 400 * 0.00095 / 2.5), rel=0.03)
    assert 0.8 * held <= proposal.proposed.gains.ff <= held


def test_the_proposal_keeps_the_margins_wherever_it_says(proposal: Proposal):
    judged = proposal.proposed
    assert judged.worst_gain[0] >= GAIN_MARGIN_DB
    assert judged.worst_phase[0] >= PHASE_MARGIN_DEG
    assert judged.margins.gain_db >= judged.worst_gain[0]
    assert judged.step.overshoot <= 5.1


def test_more_of_the_same_gains_would_break_them(proposal: Proposal):
    """The gain margin is what it says: that many dB more, and the sampled loop no longer holds still."""
    judged, structure = proposal.proposed, proposal.found.structure
    plant, w = sampled_plant(structure, 2.5, LOOP), frequencies(LOOP.period)
    angle = LOOP.angle_per_output(0.00095) * LOOP.speed_scale(2.5)
    more = 10 ** (judged.margins.gain_db / 20)
    for factor, stable in ((0.97 * more, True), (1.03 * more, False)):
        p, i = (np.array([factor * g]) for g in (judged.gains.p, judged.gains.i))
        loop = feedback_response(judged.gains, p, i, LOOP.period, w)[0] * plant.response(w) * angle
        assert (margins(loop, w).gain_db > 0) == stable


def test_another_speed_scale_changes_the_gains_by_its_factor(document: Any):
    """Nearly twice MOT_SPD_SCA_BASE is as much more steering for the same output: the loop stays the same."""
    found = replace(from_identification(document), intervals={})
    one, two = (
        propose_gains(found, autopilot({**AS_RECORDED, "MOT_SPD_SCA_BASE": base}), 3.0) for base in (1.0, 1.9)
    )
    assert one.feed_forwards[3.0] / two.feed_forwards[3.0] == pytest.approx(1.9)
    assert one.now.margins.gain_db - two.now.margins.gain_db == pytest.approx(20 * np.log10(1.9), abs=0.01)


def test_a_slow_gyro_filter_costs_gain(document: Any):
    found = replace(from_identification(document), intervals={})
    slow, fast = (
        propose_gains(found, autopilot({**AS_RECORDED, "INS_GYRO_FILTER": hz}), 2.5, at_once=True)
        for hz in (4.0, 20.0)
    )
    assert slow.proposed.worst_gain[0] >= GAIN_MARGIN_DB
    assert slow.proposed.gains.p < fast.proposed.gains.p and slow.proposed.gains.i < fast.proposed.gains.i
    assert slow.proposed.gains.d > 0 == fast.proposed.gains.d
    assert any("INS_GYRO_FILTER 4 Hz delays the loop by 56 ms" in r for r in slow.support.remarks)


def test_the_parameter_file_is_a_step_of_methodic_configurator(proposal: Proposal):
    """Its reader skips lines that begin with #, splits at the first # and then at the first comma."""
    text, gains = param_text(proposal), proposal.proposed.gains.parameters
    names = [f"ATC_STR_RAT_{k}" for k in ("FF", "P", "I", "D", "IMAX")]
    assert {p.name: p.value for p in parse(text)} == {n: gains[n] for n in names} and "2.50 m/s" in text
    steps = [line for line in text.splitlines() if line and not line.startswith("#")]
    for step in steps:
        assert re.fullmatch(r"[A-Z][A-Z0-9_]{1,15},-?[\d.]+(e-?\d+)?  # \S.*", step), step
    assert len(steps) == 5


def refused(document: Any, **at: Any) -> str:
    """The reasons of a proposal that must not be one."""
    made = propose_gains(from_identification(document), at.pop("loop", LOOP), at.pop("speed", 2.5))
    assert made.proposed is None
    assert made.support.level == "none"
    with pytest.raises(ValueError, match="no gains"):
        param_text(made)
    return " ".join(made.support.reasons)


def roll_yaw(document: Any) -> Any:
    return document["models"]["roll-yaw"]


def put(node: Any, path: list[str], value: Any) -> None:
    """Sets a value of the document; * for all of a list or a table."""
    first, *rest = path
    for key in (list(node) if isinstance(node, dict) else range(len(node))) if first == "*" else [first]:
        if rest:
            put(node[key], rest, value)
        else:
            node[key] = value


PLAIN = "models/kinematic"
FIT, APART = "models/roll-yaw/parameters", "models/roll-yaw/variants/Cf and Cr free/parameters"
POORLY_HELD_OUT = {"run": "run4", "j_rms": 2.4, "tic": 0.1}, {"run": "run4", "j_rms": 1.0, "tic": 0.4}
GOOD = {"level": "good", "sentences": []}
LATE = {"value": 1.5, "interval_90": [1.4, 1.6]}


@pytest.mark.usefixtures("few_corners")
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"models/roll-yaw/verdict": {"level": "poor", "sentences": ["J_ave 300: a poor fit"]}},
            "roll-yaw model is poor: J_ave 300",
        ),
        ({"models": {}, "recommended": None, "summary": ["too low coherence"]}, "too low coherence"),
        ({"models/*/verification_runs": []}, "no run was held out"),
        (
            {"models/*/verification_runs": [POORLY_HELD_OUT[0]]},
            "does not predict run4, which was held out: J_rms 2.4",
        ),
        ({"models/*/verification_runs": [POORLY_HELD_OUT[1]]}, "TIC 0.40 (at most 0.35)"),
        (
            {f"{FIT}/Izz/value": 0.7, f"{FIT}/Izz/interval_90": [0.6, 0.8]},
            "kg m^2 is implausible: it is 10.1 times the 0.069",
        ),
        (
            {
                "recommended": "kinematic",
                f"{PLAIN}/verdict": GOOD,
                f"{PLAIN}/parameters/L_eff/value": 1.2,
                f"{PLAIN}/parameters/L_eff/interval_90": [1.1, 1.3],
            },
            "a steering scale of 0.33 times rad_per_us is implausible",
        ),
        ({"recommended": None, "summary": ["why it is so"]}, "why it is so"),  # though others fit
        ({"groups/0/responses/r/band": [0.3, 1.0]}, "not coherent (usable from 0.3 to 1 rad/s)"),
        ({f"{fit}/tau/{k}": v for fit in (FIT, APART) for k, v in LATE.items()}, "make the loop too slow"),
        ({"vehicle/steering": None}, "rad_per_us"),
        ({"runs/*/amplitude": 400.0, "runs/*/amplitude_unit": "us"}, "stops"),
        ({f"{FIT}/Cf/value": 60.0, f"{FIT}/Cr/value": 8.0}, "above its critical speed"),
    ],
)
def test_unsound_identifications_support_nothing(document: Any, changes: dict[str, Any], words: str):
    for path, value in changes.items():
        put(document, [int(key) if key == "0" else key for key in path.split("/")], value)
    assert words in refused(document)


def test_far_speeds_and_a_reversed_servo_support_nothing(document: Any):
    for speed in (1.0, 4.5):
        assert "too far from the runs" in refused(document, speed=speed)
    assert "SERVO1_REVERSED" in refused(document, loop=autopilot({"SERVO1_REVERSED": 1.0}))


def test_the_kinematic_model_carries_the_feed_forward_alone(document: Any):
    document["models"]["kinematic"]["verdict"] = {"level": "good", "sentences": []}
    found = replace(from_identification(document, "kinematic"), doubts=())
    assert propose_gains(found, LOOP, 2.5).proposed.gains.ff == 0.4, "twice the default"
    made = propose_gains(found, LOOP, 2.5, at_once=True)
    assert made.support.level == "feed-forward only"
    wheelbase = document["models"]["kinematic"]["parameters"]["L_eff"]["value"]
    assert made.proposed.gains.ff == pytest.approx(wheelbase / 0.38, abs=0.001)
    assert (made.proposed.gains.p, made.proposed.gains.i) == (0.2, 0.2)
    assert [p.name for p in parse(param_text(made))] == ["ATC_STR_RAT_FF"]


def test_at_the_scales_base_it_says_that_the_integrator_is_held(document: Any):
    found = replace(from_identification(document), intervals={})
    made = propose_gains(found, autopilot({**AS_RECORDED, "MOT_SPD_SCA_BASE": 2.6}), 2.5)
    assert any("only lets the integrator shrink" in remark for remark in made.support.remarks)


def test_without_intervals_the_cramer_rao_bound_makes_the_family(document: Any):
    for p in roll_yaw(document)["parameters"].values():
        p["interval_90"] = None
    found = from_identification(document)
    low, high = found.intervals["Izz"]
    cr = roll_yaw(document)["parameters"]["Izz"]["cr_percent"] / 100
    assert high / low == pytest.approx((1 + 1.645 * cr) / (1 - 1.645 * cr), rel=1e-6)


@pytest.mark.usefixtures("few_corners")
def test_play_that_the_bench_took_out_is_said_to_be_no_part_of_the_loop(document: Any, proposal: Proposal):
    assert not any("play" in remark for remark in proposal.support.remarks)
    document["vehicle"]["steering"]["backlash"] = {"value": 0.012, "sd": 1e-4}
    remarks = propose_gains(from_identification(document), LOOP, 2.5).support.remarks
    assert any("play (0.012 rad to each side)" in remark for remark in remarks)


def test_a_command_where_it_was_set_waited_for_the_main_loop_and_that_is_off_the_delay(document: Any):
    tau = roll_yaw(document)["variants"]["Cf and Cr free"]["parameters"]["tau"]["value"]
    delta = document["runs"][0]["channels"]["delta"]
    assert delta["source"] == "SWEP.Out at the main loop"
    for source, wait in ((delta["source"], 0.0), ("SWEP.Out", 0.005), ("SERVO_OUTPUT_RAW.servo1_raw", 0.0)):
        delta["source"] = source
        assert from_identification(document).structure.values["tau"] == pytest.approx(tau - wait)


def test_the_requirement_that_no_gains_meet_is_named(proposal: Proposal, monkeypatch: pytest.MonkeyPatch):
    most = unbounded(LOOP.gains)
    family = family_of(replace(proposal.found, intervals={}), LOOP, 2.5)
    monkeypatch.setattr(tuning, "MOST_OVERSHOOT", -100.0)
    assert design_gains(family, LOOP.gains, most) is None
    assert "6 dB and 45 deg overshoots a step" in why_none(family, LOOP.gains, most)
    monkeypatch.setattr(tuning, "GAIN_MARGIN_DB", 90.0)
    assert why_none(family, LOOP.gains, most).startswith("no P and I keep 90 dB")


def test_another_speed_at_which_gains_exist_is_named(proposal: Proposal, monkeypatch: pytest.MonkeyPatch):
    design = tuning.design_gains
    slow = lambda family, *rest: design(family, *rest) if family.nominal.speed < 2.0 else None  # noqa: E731
    monkeypatch.setattr(proposals, "design_gains", slow)
    monkeypatch.setattr(proposals, "MOST_CORNERS", 1)
    (why,) = propose_gains(proposal.found, LOOP, 2.5, at_once=True).support.reasons
    assert why.endswith("at 1.8 m/s there are such gains (--speed 1.8)")
