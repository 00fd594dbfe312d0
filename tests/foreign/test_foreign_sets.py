"""A drawn set: what the tool reads, its noise, its size, and the run it is told of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rover_sweep.quality.verdict import assess
from tests.foreign.draw import KINDS, LISTED, Hidden, conceal, draw, laws
from tests.foreign.drive import drives, wave
from tests.foreign.instruments import filtered, lagged
from tests.foreign.motion import DT
from tests.foreign.outside_laws import OUTSIDE_LAWS
from tests.foreign.recorded import driven, runs_of
from tests.foreign.rover import SIZES, Rover, draw_rover, vehicle_toml
from tests.foreign.sizing import Scale, scale_of


def rover(size: int = 1, seed: int = 3) -> Rover:
    return draw_rover(np.random.default_rng(seed), SIZES[size])


def test_the_tool_reads_a_set_without_a_remark() -> None:
    drawn = draw("none", 2)
    assert drawn.hidden == () and draw("none", 2).rover == drawn.rover
    runs, held_out = runs_of(drawn.rover, drawn.plan, 2)
    assert [run.kind for run in (*runs, *held_out)] == ["sweep", "sweep", "sweep", "doublet"]
    assert all(not run.notes for run in (*runs, *held_out))
    assert all(assess(run).keep for run in runs)
    i = drawn.rover.instruments
    assert runs[0]["r"].rate == pytest.approx(i.loop_hz, rel=0.01)
    assert runs[0].filters["ay"].cutoff_hz == i.accel_hz
    assert runs[0].mean_speed == pytest.approx(drawn.rover.speed, rel=0.12)
    assert np.max(np.abs(runs[1].manoeuvre("delta").x)) == pytest.approx(drawn.rover.amplitude, rel=0.05)


@pytest.mark.parametrize("size", range(4))
def test_noise_is_that_of_recorded_rovers(size: int) -> None:
    """Straight on the official firmware: r .005 to .02 rad/s, a_y .07 to .2 m/s^2, p .015 to .04 rad/s."""
    some = rover(size)
    plan = drives(np.random.default_rng(1), some)
    found, undisturbed = (
        driven(some, plan[3], np.random.default_rng(5), noise)[2] for noise in (True, False)
    )
    inside = slice(round(plan[3].begin / DT), round(plan[3].end / DT))
    ranges = {"r": (0.004, 0.03), "ay": (0.07, 0.4), "p": (0.008, 0.06)}
    for name, (low, high) in ranges.items():
        gap = (found[name] - undisturbed[name])[inside]
        assert low < np.std(gap) < high, name


def test_what_the_owner_told_is_off_by_normal_tolerances() -> None:
    for seed in range(30):
        some = rover(seed % 4, seed)
        told, n = some.told, some.numbers
        assert abs(told["cg_to_front_axle"] - n.a) < 0.0101
        assert abs(told["roll_inertia"] / n.Ixx - 1) < 0.151
        assert abs(np.log(n.Cf / n.Cr)) < 0.121
        assert abs(some.instruments.accel_bias) < 0.3
        assert "position" in vehicle_toml(told)


def test_every_law_has_an_end_of_its_range_that_changes_the_runs() -> None:
    """One run of every law in a rover of some size: it stays finite at its smallest size and differs."""
    some = rover()
    plan = drives(np.random.default_rng(2), some)
    plan = tuple(replace(drive, kind="doublet") for drive in plan)
    plain = {k: driven(some, plan[k], np.random.default_rng(1), noise=False)[2] for k in (1, 2)}
    for law in (*LISTED, *OUTSIDE_LAWS):
        extras = law.extras(np.random.default_rng(4))
        extras = {**extras, "run": 2.0, "at": 4.0} if "run" in extras else extras
        changed = law.apply(some, (law.low * law.high) ** 0.5, extras)
        assert changed != some
        which = 2 if law.effect in ("outside:speed_steering", "outside:slip_speed") else 1
        found = driven(changed, plan[which], np.random.default_rng(1), noise=False)[2]
        gap = max(float(np.max(np.abs(found[c] - plain[which][c]))) for c in ("r", "ay", "p", "vy"))
        assert np.isfinite(gap) and gap > 1e-3, (law.effect, law.form)


def test_kinds_draw_from_their_laws() -> None:
    assert {law.effect for law in laws("single")} >= {law.effect for law in laws("foreign_form")}
    assert not {(law.effect, law.form) for law in laws("single")} & {
        (law.effect, law.form) for law in laws("foreign_form")
    }
    assert all(law.effect.startswith("outside:") for law in laws("outside"))
    assert set(KINDS) == {"none", "single", "double", "triple", "foreign_form", "outside"}


def test_a_law_is_sized_to_be_seen() -> None:
    some, rng = rover(), np.random.default_rng(8)
    plan = drives(rng, some)[:2]
    scale = scale_of(some, plan[:1], rng)
    law = next(one for one in LISTED if one.effect == "steering_backlash")
    found = conceal(some, law, scale, rng)
    assert isinstance(found, tuple) and isinstance(found[0], Hidden) and isinstance(scale, Scale)
    assert 0.35 <= found[0].visibility < 3.0
    assert law.low <= found[1] <= law.high
    assert scale.visibility(scale.nominal, law) == pytest.approx(0.0, abs=1e-6)


def test_the_sweep_follows_tischler_and_remple() -> None:
    plan = drives(np.random.default_rng(1), rover())
    t = np.arange(0, plan[0].length, DT)
    unit = wave(plan[0], t)
    crossings = t[1:][np.diff(np.sign(unit)) != 0]
    last = crossings[crossings < plan[0].end - 5.5]
    assert np.max(np.abs(unit)) == pytest.approx(1.0, abs=1e-3)
    assert np.pi / np.diff(last)[-1] == pytest.approx(24.5, rel=0.04)
    assert np.all(unit[t < plan[0].begin + 3.0] == 0.0)


def test_low_passes_have_their_gain() -> None:
    t = np.arange(0, 8, DT)
    wave_ = np.sin(2 * np.pi * 4.0 * t)
    assert np.std(filtered(wave_, 4.0)[3000:]) / np.std(wave_) == pytest.approx(0.707, abs=0.01)
    lag = 1 / (2 * np.pi * 4.0)
    assert np.std(lagged(wave_, lag, "first order")[3000:]) / np.std(wave_) == pytest.approx(0.707, abs=0.01)
    assert lagged(wave_, 0.05, "delay")[1050] == wave_[1000]


def test_a_sliding_load_moves_the_cg_away_from_the_imu() -> None:
    """V_y at the IMU, above the same place of the vehicle, hardly changes while the CG moves under it."""
    some = rover()
    plan = drives(np.random.default_rng(2), some)
    law = next(one for one in OUTSIDE_LAWS if one.effect == "outside:sliding_cargo")
    changed = law.apply(some, 0.1, {"sign": 1.0, "run": 1.0, "at": 10.0})
    before, after = (
        driven(one, plan[0], np.random.default_rng(1), noise=False)[2] for one in (some, changed)
    )
    until = round((plan[0].begin + 10.0) / DT)
    assert np.array_equal(before["vy"][:until], after["vy"][:until])
    r, gap = before["r"][until:], (after["vy"] - before["vy"])[until:]
    assert np.max(np.abs(gap)) < np.max(np.abs(r)) * 0.1 * (some.numbers.a + some.numbers.b)
    assert np.max(np.abs(after["r"] - before["r"])[until:]) > 0.01
