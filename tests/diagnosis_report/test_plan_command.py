"""`rover-sweep plan`: the runs that the engine is asked about, and the JSON."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from fabricated_engine import Engine, ProgramResult

from rover_sweep.diagnosis.plans.planner import PlannedRun

DATA = Path(__file__).parents[1] / "data"
NOMINAL = DATA / "ardurover-4.6.3" / "nominal"
VEHICLE = ("--vehicle", DATA / "rover.toml")
RunProgram = Callable[..., ProgramResult]


def test_runs_thought_of_are_asked_about(engine: Engine, run_program: RunProgram) -> None:
    sweeps = ("--sweep", "150@2.4", "--sweep", "150@2.4", "--sweep", "240@2.4@450")
    others = {"--doublet": "150@1.6", "--bias-sweep": "100-150@2.4", "--multisine": "200@2"}
    more = [word for pair in others.items() for word in pair]
    code, out, _ = run_program("plan", *VEHICLE, *sweeps, *more, "--servo-test", "90")
    assert code == 0 and out.startswith("These runs cannot tell tyre relaxation from a delay")
    assert engine.given["runs"] == (
        PlannedRun("sweep", 150.0, 2.4, repeat=2),
        PlannedRun("sweep", 240.0, 2.4, 90.0),
        PlannedRun("doublet", 150.0, 1.6),
        PlannedRun("bias_sweep", 100.0, 2.4, None, -150.0),
        PlannedRun("multisine", 200.0, 2.0),
        PlannedRun("servo_test", 90.0, 0.0),
    )
    assert engine.given["rad_per_us"] == pytest.approx(0.00095)
    assert engine.given["limits"].ay == pytest.approx(0.8 * 0.9 * 9.81)


def test_runs_driven_are_measured(engine: Engine, run_program: RunProgram) -> None:
    """As the README of the recordings has them: 120 us at 2.5 m/s, 150 us at 1.65 m/s, a doublet of 150."""
    files = ("run1.BIN", "run3.BIN", "run4.BIN")
    run_program("plan", *VEHICLE, *(a for name in files for a in ("--have", NOMINAL / name)))
    first, slow, doublet = engine.given["runs"]
    assert (first.kind, first.name) == ("sweep", "run1") and doublet.kind == "doublet"
    assert [r.amplitude_us for r in (first, slow, doublet)] == pytest.approx([120, 150, 150], abs=2)
    assert [r.speed for r in (first, slow, doublet)] == pytest.approx([2.5, 1.65, 2.5], abs=0.1)
    assert all(r.bias_us == 0.0 and 0.0 <= r.heading < 360.0 for r in (first, slow, doublet))
    assert list(engine.given["driven"]) == ["run1", "run3", "run4"]
    assert engine.given["driven"]["run3"].mean_speed == pytest.approx(1.65, abs=0.1)


def test_json_has_everything(engine: Engine, run_program: RunProgram) -> None:
    told = run_program("plan", *VEHICLE, "--sweep", "150@2.4", "--want", "servo_lag", "--json")
    document = json.loads(told.out)
    assert engine.given["wanted"] == ("servo_lag",)
    size = {"parameter": "b", "unit": "rad", "size": 0.0021, "material": 0.003}
    assert document["detectable"]["steering_backlash"] == size
    pair = {"first": "tyre_relaxation", "second": "transport_delay", "probability": 0.48}
    assert document["not_told_apart"][0] == pair
    assert document["proposal"][1]["bias_us"] == 150.0
    assert document["settles"][1] == "sweep about a bias: 0.1 bit of information"
    assert document["notes"] == ["no run is proposed beyond 3.9 m/s^2 of lateral acceleration"]
    assert document["cannot_see"] == [{"effect": "cross_slope", "why": "one heading"}]


MISTAKES = [
    (("--sweep", "150"), "'150' has no speed; write it as 150@2.4"),
    (("--sweep", "-150@2.4"), "negative amplitude"),
    (("--sweep", "1,5@2.4"), "decimal comma"),
    (("--sweep", "nan@2.4"), "is not a run; write it as 150@2.4"),
    (("--sweep", "150@inf"), "is not a run; write it as 150@2.4"),
    (("--bias-sweep", "300+300@2.4"), "1..500 us, bias included"),
    (("--servo-test", "-90"), "1<=x<=500"),
    (("--servo-test", "90@2.4"), "not a valid number"),
    (("--bias-sweep", "150@2.4"), "has no bias; write it as 100+150@2.4"),
    (("--sweep", "100+50@2.4"), "which only --bias-sweep takes; write it as 150@2.4"),
    (("--sweep", "900@2.4"), "1..500 us"),
    (("--doublet", "150@0"), "a speed up to 30 m/s"),
    (("--want", "tyre_slip"), "no run can show tyre_slip with the roll-yaw baseline of this plan"),
    (("--want", "roll_dof,speed_variation"), "no run can show roll_dof, speed_variation with"),
    (("--want", "servo"), "there is no effect 'servo'"),
]


def test_mistakes_end_with_a_sentence(engine: Engine, run_program: RunProgram) -> None:
    for arguments, words in MISTAKES:
        code, out, err = run_program("plan", *VEHICLE, *arguments)
        assert code == 2 and words in err and not out and not engine.given, words
