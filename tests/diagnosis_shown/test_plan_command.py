"""`rover-sweep plan`: the runs that the engine is asked about, and the JSON."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from fabricated_engine import Engine, Told

from rover_sweep.diagnosis.plan_types import PlannedRun

DATA = Path(__file__).parents[1] / "data"
NOMINAL = DATA / "ardurover-4.6.3" / "nominal"
VEHICLE = ("--vehicle", DATA / "rover.toml")
Tell = Callable[..., Told]


def test_runs_thought_of_are_asked_about(engine: Engine, told: Tell) -> None:
    sweeps = ("--sweep", "150@2.4", "--sweep", "150@2.4", "--sweep", "240@2.4@450")
    others = ("--doublet", "150@1.6", "--bias-sweep", "100-150@2.4", "--multisine", "200@2")
    code, out, _ = told("plan", *VEHICLE, *sweeps, *others)
    assert code == 0 and out.startswith("These runs cannot tell tyre relaxation from a delay")
    assert engine.given["runs"] == (
        PlannedRun("sweep", 150.0, 2.4, repeat=2), PlannedRun("sweep", 240.0, 2.4, 90.0),
        PlannedRun("doublet", 150.0, 1.6), PlannedRun("bias_sweep", 100.0, 2.4, None, -150.0),
        PlannedRun("multisine", 200.0, 2.0),
    )  # fmt: skip
    assert engine.given["rad_per_us"] == pytest.approx(0.00095)


def test_runs_driven_are_measured(engine: Engine, told: Tell) -> None:
    """As the README of the recordings has them: 120 us at 2.5 m/s, 150 us at 1.65 m/s, a doublet of 150."""
    files = ("run1.BIN", "run3.BIN", "run4.BIN")
    told("plan", *VEHICLE, *(a for name in files for a in ("--have", NOMINAL / name)))
    first, slow, doublet = engine.given["runs"]
    assert (first.kind, first.name) == ("sweep", "run1") and doublet.kind == "doublet"
    assert [r.amplitude_us for r in (first, slow, doublet)] == pytest.approx([120, 150, 150], abs=2)
    assert [r.speed for r in (first, slow, doublet)] == pytest.approx([2.5, 1.65, 2.5], abs=0.1)
    assert all(r.bias_us == 0.0 and 0.0 <= r.heading < 360.0 for r in (first, slow, doublet))


def test_json_has_everything(engine: Engine, told: Tell) -> None:
    document = json.loads(told("plan", *VEHICLE, "--sweep", "150@2.4", "--want", "servo_lag", "--json").out)
    assert engine.given["wanted"] == ("servo_lag",)
    assert document["detectable"]["steering_backlash"] == {
        "parameter": "b", "unit": "rad", "size": 0.0021, "material": 0.003
    }  # fmt: skip
    assert document["not_told_apart"][0] == {
        "first": "tyre_relaxation", "second": "transport_delay", "cosine": 0.991
    }  # fmt: skip
    assert document["proposal"][1]["bias_us"] == 150.0
    assert document["cannot_see"] == [{"effect": "cross_slope", "why": "one heading"}]


@pytest.mark.parametrize(("arguments", "words"), [
    (("--sweep", "150"), "write it as 150@2.4"),
    (("--bias-sweep", "150@2.4"), "write it as 100+150@2.4"),
    (("--sweep", "100+50@2.4"), "write it as 150@2.4"),
    (("--sweep", "900@2.4"), "1..500 us"),
    (("--doublet", "150@0"), "a speed up to 30 m/s"),
    (("--want", "servo"), "there is no effect 'servo'"),
])  # fmt: skip
def test_mistakes_end_with_a_sentence(
    arguments: tuple[str, ...], words: str, engine: Engine, told: Tell
) -> None:
    code, out, err = told("plan", *VEHICLE, *arguments)
    assert code == 2 and words in err and not out and not engine.given
