"""Each engine: signs, steady turn, symmetry, switched-off effects; the drawn sets and their marks."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.engines.draw import KINDS, drawn_set
from tests.engines.engine import CHANNELS, MODULES, Engine, EngineRover, Signals, drawn_rover, driven, engine
from tests.engines.judge import brier, judged, reliability, removed, table, within
from tests.foreign.laws import LISTED
from tests.foreign.outside_laws import OUTSIDE_LAWS
from tests.foreign.plant import DT, SURFACE
from tests.foreign.recorded import drives

SECONDS = 11.0
STEERED = 6.0
ENGINES = [  # the others are compiled for 20 s each
    n if n in ("foreign", "mujoco", "slipx") else pytest.param(n, marks=pytest.mark.slow) for n in MODULES
]


def used(name: str) -> Engine:
    pytest.importorskip(MODULES[name][1])
    return engine(name)


def rover(name: str, size: int = 0) -> EngineRover:
    """Its sensors sit straight at the CG's place and its servo has no trim."""
    found = drawn_rover(np.random.default_rng(5), used(name).sizes[size])
    return found.sensing(tilt=(0.0, 0.0, 0.0), imu_x=0.0)  # type: ignore[return-value]


@cache
def turned(name: str, sign: float = 1.0, size: int = 0) -> Signals:
    """A steady turn with .5 of the large amplitude, to the left for sign 1."""
    return driven_by(name, rover(name, size), sign)


def driven_by(name: str, some: EngineRover, sign: float = 1.0) -> Signals:
    t = np.arange(round(SECONDS / DT)) * DT
    command = np.where(t > STEERED, 0.5 * sign * some.amplitude, 0.0)
    around = np.zeros((t.size, 7))
    around[:, SURFACE] = 1.0
    return used(name).signals(some, command, np.where(t > 0.5, some.speed, 0.0), around, 0.3)


@pytest.mark.parametrize("name", ENGINES)
def test_a_turn_has_the_signs_of_iso_obeys_kinematics_and_is_mirrored_to_the_right(name: str) -> None:
    some, x, right = rover(name), turned(name), turned(name, -1.0)
    n = some.numbers
    assert set(x) >= set(CHANNELS)
    assert all(np.all(np.isfinite(x[c])) and x[c].shape == (11000,) for c in CHANNELS)
    r, phi, ay = (x[c][-1] for c in ("r", "phi", "ay"))
    assert r > 0.1 and ay > 0.5 and phi > 0.005  # the body leans outward: its left side rises
    assert x["psi"][-1] > 1.0 and x["psi"][0] == pytest.approx(0.3, abs=1e-3)
    assert np.max(x["p"][slice(round(STEERED / DT), round((STEERED + 0.3) / DT))]) > 0.01

    end = slice(-2000, None)
    turn, speed = np.mean(x["psi"][-1] - x["psi"][-2001]) / 2.0, np.mean(x["speed"][end])
    assert np.mean(x["r"][end]) == pytest.approx(turn * np.cos(np.mean(x["phi"][end])), rel=0.01)
    gravity = 9.81 * np.mean(np.sin(x["phi"][end]))
    assert np.mean(x["ay"][end]) == pytest.approx(speed * turn + gravity, rel=0.03)
    assert turn == pytest.approx(speed * np.tan(0.5 * some.amplitude) / (n.a + n.b), rel=0.25)
    lean = n.ms * n.h * speed * turn / (n.kphi - n.ms * 9.81 * n.h)
    assert np.mean(x["phi"][end]) == pytest.approx(lean, rel=0.35)

    for c in ("r", "p", "ay", "vy", "phi"):
        assert np.allclose(x[c], -right[c], atol=2e-3 * np.max(np.abs(x[c]))), c
    assert np.allclose(x["speed"], right["speed"], atol=1e-3)


@pytest.mark.parametrize("name", ENGINES)
def test_a_size_of_zero_changes_nothing_and_the_imu_moves_with_a_rigid_body(name: str) -> None:
    some, plain = rover(name), turned(name)
    same = driven_by(name, some.having(pendulum=0.0, mast=0.0, slip_speed=0.0, plysteer=0.0, spool=0.0))
    assert np.array_equal(same["ay"], plain["ay"])
    moved = driven_by(name, some.sensing(imu_x=0.1))  # type: ignore[arg-type]
    begin = slice(round(STEERED / DT), round((STEERED + 1.0) / DT))
    wanted = 0.1 * np.gradient(plain["r"], DT)[begin]
    gap = (moved["ay"] - plain["ay"])[begin]
    assert np.std(gap - wanted) < 0.15 * np.std(wanted)
    assert {law.effect for law in used(name).outside} <= set(used(name).places)
    assert used(name).name == name


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in MODULES if name != "foreign"])
def test_every_effect_of_an_engines_own_changes_a_turn(name: str) -> None:
    some, plain = rover(name), turned(name)
    for law in (*used(name).listed, *used(name).outside):
        if law in (*LISTED, *OUTSIDE_LAWS) or "run" in law.extras(np.random.default_rng(1)):
            continue
        changed = law.apply(some, law.high, law.extras(np.random.default_rng(1)))
        x = driven_by(name, changed)  # type: ignore[arg-type]
        gap = max(float(np.max(np.abs(x[c] - plain[c]))) for c in ("r", "ay", "p", "vy"))
        assert np.isfinite(gap) and gap > 1e-3, (law.effect, law.form)


def test_the_owners_errors_are_those_of_people() -> None:
    sizes = used("foreign").sizes
    found = [drawn_rover(np.random.default_rng(k), sizes[k % 4]) for k in range(60)]
    h = [f.told["cg_height_above_roll_centre"] / f.numbers.h - 1 for f in found]
    mass = [f.told["mass"] / f.numbers.m - 1 for f in found]
    assert 0.14 < np.std(h) < 0.26 and 0.006 < np.std(mass) < 0.014
    assert 10 < sum("yaw_inertia" in f.told for f in found) < 40


def test_the_same_arguments_give_the_same_set(tmp_path: Path) -> None:
    one, again = (drawn_set("foreign", "single", 1, folder) for folder in (None, tmp_path))
    kept = drawn_set("foreign", "single", 1, tmp_path)
    assert one.truth == again.truth == kept.truth and len(one.hidden) == 1
    assert one.truth["hidden"][0]["visibility"] >= 0.35
    for other in (again, kept):
        assert np.array_equal(one.runs[1]["ay"].x, other.runs[1]["ay"].x)
    assert [r.kind for r in (*one.runs, *one.held_out)] == ["sweep", "sweep", "sweep", "doublet"]


@pytest.mark.parametrize("name", ENGINES[1:])
def test_the_tool_reads_a_run_of_each_engine(name: str) -> None:
    some = drawn_rover(np.random.default_rng(2), used(name).sizes[0])
    drive = drives(np.random.default_rng(3), some)[3]
    noisy, plain = (
        driven(used(name), some, drive, np.random.default_rng(4), noise)[2] for noise in (True, False)
    )
    inside = slice(round(drive.begin / DT), round(drive.end / DT))
    for c, low, high in (("r", 0.004, 0.04), ("ay", 0.07, 0.5), ("p", 0.008, 0.08)):
        assert low < np.std((noisy[c] - plain[c])[inside]) < high, c


def said(*findings: tuple[str, float], share: float = 0.8) -> dict[str, Any]:
    named = [{"effect": e, "look_alikes": [], "probability": p} for e, p in findings]
    held_out = [{"run": "run4", "share_removed": share}]
    return {"verdict": "", "findings": named, "unknown": None, "held_out": held_out, "seconds": 2.0}


def test_a_table_of_invented_answers() -> None:
    drawn: dict[str, Any] = {"engine": "foreign", "seed": 1, "kind": "none", "hidden": []}
    planted = {**drawn, "kind": "single", "hidden": [{"effect": "imu_offset"}]}
    two = {**drawn, "kind": "double", "hidden": [{"effect": "imu_offset"}, {"effect": "servo_lag"}]}
    rows = [
        judged(drawn, said(), {}),
        judged(drawn, said(("imu_offset", 0.9)), {}),
        judged(planted, said(("imu_offset", 0.9)), {}),
        judged(planted, said(("roll_steer", 0.6), share=0.2), {}),
        judged(two, said(("servo_lag", 0.9), ("imu_offset", 0.7)), {}),
    ]
    assert [r.halved for r in rows] == [True, True, True, False, True]
    assert brier(rows[3].said) == pytest.approx(0.36) and brier([]) is None
    text = table(rows)
    assert "| foreign | none   | 2    | -     | 1/2" in text
    assert "| foreign | double | 1    | 1/1   | 0/1        | 1/1 " in text
    text = table([*rows, judged({**planted, "engine": "slipx"}, said(), {})])
    assert "| all     | single | 3 " in text and "| all" not in table(rows)
    assert removed(None) is None and removed({"share_removed": 0.4}) == 0.4
    assert set(KINDS) == {"none", "single", "double", "outside", "triple", "foreign_form"}


def test_probabilities_and_bounds_against_the_truth() -> None:
    hidden = {"effect": "imu_offset", "value": 0.04, "unit": "m"}
    drawn: dict[str, Any] = {"engine": "foreign", "seed": 1, "kind": "single", "hidden": [hidden]}
    nothing: dict[str, Any] = {**drawn, "kind": "none", "hidden": []}
    bound = {"x": {"unit": "m", "low": -0.05, "high": 0.02}}
    missed = {**said(), "p_none": 0.7, "cannot_see": [{"effect": "imu_offset", "up_to": bound}]}
    rows = [
        judged(drawn, said(("imu_offset", 0.9), ("roll_steer", 0.88)), {}),
        judged(drawn, missed, {}),
        judged(nothing, {**said(), "p_none": 1.0}, {}),
    ]
    text = reliability(rows)
    assert "| 0.85-0.95 | 2        | 0.89      | 0.50  | 0    | -         | -     |" in text
    assert "| 0.60-0.75 | 0        | -         | -     | 1    | 0.70      | 0.00  |" in text
    assert "| 0.95-1.00 | 0        | -         | -     | 1    | 1.00      | 1.00  |" in text
    assert text.endswith("hold the truth: 1/1")
    assert within(0.1, 0.85, 1.05) and not within(0.2, 0.85, 1.05) and not within(0.5, 0.7, None)
