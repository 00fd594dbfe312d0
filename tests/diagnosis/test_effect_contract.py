"""The contract of all effects: no change at coordinate 0, a change at a plain size, and complete texts."""

from dataclasses import replace

import numpy as np
import pytest

from rover_sweep.data.geometry import Geometry, Tolerances
from rover_sweep.diagnosis.effects import every_form, form_named, forms_of, library
from rover_sweep.diagnosis.effects.effect import SpeedEffect
from rover_sweep.diagnosis.effects.steering import jumps, play, sticks
from rover_sweep.diagnosis.simulation.candidates import DEGREES_OF_FREEDOM, Model, added_coordinates
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment, in_order
from rover_sweep.diagnosis.simulation.simulator import logged
from rover_sweep.manoeuvre.sweep import Sweep

ROVER = Geometry(2.66, 0.203, 0.188, 2.40, 0.058, 0.0125, 0.07, 0.02, 0.03)
MODEL = Model("roll-yaw", ROVER, Tolerances())
NOMINAL = {c.name: c.start for c in MODEL.free}
TERMS = [
    e for e in every_form().values() if e.id not in DEGREES_OF_FREEDOM and not isinstance(e, SpeedEffect)
]


def driven() -> Experiment:
    law = Sweep(240.0, t_rec=20.0)
    t = np.arange(int(law.duration * RATE)) / RATE
    steer = -0.00095 * np.asarray(law.wave(t))
    speed = 2.4 + 0.1 * np.sin(0.5 * t)
    channels = dict.fromkeys(("r", "ay", "p", "vy"), t)
    return Experiment("run1", "sweep", t, steer, speed, 0.3 + 0.02 * t, channels, {}, {}, np.ones(t.size))


RUN = driven()


def log_with(effect, coordinates):
    model = replace(MODEL, effects=(effect.name,), happened_in="run1")
    return logged(RUN, model, {**NOMINAL, **coordinates})


PLAIN = logged(RUN, MODEL, NOMINAL)


def coordinates_of(effect, factor):
    out = {}
    for p in effect.parameters:
        name = effect.coordinate_name(p)
        out[name] = NOMINAL.get(name, 0.0) + factor * p.size * p.per
    if effect.in_one_run and any(p.name == "t" for p in effect.parameters):
        out[effect.key("t")] = 10.0
    return out


@pytest.mark.parametrize("effect", TERMS, ids=lambda e: e.name)
def test_vanishes_at_its_absent_value_and_moves_a_channel_that_it_names(effect):
    for channel, y in log_with(effect, coordinates_of(effect, 0.0)).items():
        assert y == pytest.approx(PLAIN[channel], abs=1e-9)
    found = log_with(effect, coordinates_of(effect, 1.0))
    moved = {c for c in found if np.std(found[c] - PLAIN[c]) + abs(np.mean(found[c] - PLAIN[c])) > 1e-4}
    assert moved & set(effect.channels)


def test_every_effect_that_may_act_beside_derivatives_can_be_simulated():
    """A slope looked for the sprung mass's moment, which the derivatives do not have."""
    model = Model("lumped", ROVER, Tolerances())
    for effect in (e for e in library().values() if "lumped" in e.baselines):
        if effect.id in DEGREES_OF_FREEDOM:
            continue
        whole = model.with_effect(effect.id, RUN.name)
        x = {c.name: c.start for c in whole.free}
        x |= {c.name: 0.25 * c.scale for c in added_coordinates(whole.law(effect.id))}
        found = logged(RUN, whole, x)
        assert found and all(np.all(np.isfinite(y)) for y in found.values()), effect.id


@pytest.mark.parametrize("effect", every_form().values(), ids=lambda e: e.name)
def test_says_what_it_is(effect):
    for text in (effect.title, effect.equation, effect.source, effect.apart, effect.next_run):
        assert text.strip()
    for p in effect.parameters:
        assert p.unit and p.convention and p.low <= 0 <= p.high
        assert p.coordinate(p.value(0.3 * p.high)) == pytest.approx(0.3 * p.high)


@pytest.mark.parametrize(("effect", "growth"), [("steering_nonlinearity", 64.0), ("steering_backlash", 1.3)])
def test_residual_power_grows_as_the_vocabulary_says(effect, growth):
    """When the amplitude doubles: a cubic by 2^6, the first order of a play hardly."""
    e = library()[effect]
    model = replace(MODEL, effects=(e.id,))
    power = []
    for scale in (0.5, 1.0):
        run = replace(RUN, steer=scale * RUN.steer, commanded=None)
        with_it = logged(run, model, {**NOMINAL, **coordinates_of(e, 1.0)})
        without = logged(run, MODEL, NOMINAL)
        power.append(np.mean((with_it["r"] - without["r"]) ** 2))
    assert power[1] / power[0] == pytest.approx(growth, rel=0.35)


def test_a_form_is_a_law_of_its_family():
    for name, law in every_form().items():
        assert (law.name, form_named(name)) == (name, law)
        assert law.first == (name in library())
        assert law.form or len(forms_of(law.id)) == 1
    for effect in library():
        family = forms_of(effect)
        assert family[0].name == effect and len({law.form for law in family}) == len(family)
        assert all(law.id == effect for law in family)
        assert {law.equation for law in family if not law.first}.isdisjoint({family[0].equation})


def test_a_servo_that_sticks_goes_all_the_way_and_play_has_a_memory():
    u = np.array([0.0, 0.01, 0.02, 0.03, 0.02, 0.01, 0.0])
    assert jumps(u, 0.015) == pytest.approx([0.0, 0.0, 0.02, 0.02, 0.02, 0.02, 0.0])
    assert sticks(u, 0.015) == pytest.approx([0.0, 0.0, 0.02, 0.03, 0.03, 0.01, 0.0])
    steer = 0.2 * np.sin(2 * np.pi * np.arange(400) / RATE)
    out = play(steer, 0.05)
    assert np.max(np.abs(out)) == pytest.approx(0.15, abs=1e-3)
    assert np.max(np.abs(steer - out)) == pytest.approx(0.05, abs=1e-9)


def test_runs_of_one_clock_are_in_the_order_of_driving():
    early, late = replace(RUN, begin=10.0), replace(RUN, begin=20.0 + RUN.t.size / RATE)
    placed = in_order([late, early])
    assert [r.order for r in placed] == [1, 0] and placed[0].driven == pytest.approx(float(early.t[-1]))
    again = in_order([replace(late, begin=5.0), replace(early, begin=6.0)])  # after a restart: as given
    assert [r.order for r in again] == [0, 1]
