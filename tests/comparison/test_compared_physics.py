"""The comparison on recordings of the simulated rover, whose laws share nothing with the identification."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rover_sweep as rs
from rover_sweep.api.diagnose import compared
from rover_sweep.comparison.common_model import common_model, side_of
from rover_sweep.data.geometry import Tolerances
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.posterior.model_fit import fit_with_floor
from rover_sweep.diagnosis.result import Diagnosis
from rover_sweep.diagnosis.simulation.augmented import augmented
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import experiment
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.report.comparison_report import write_comparison
from rover_sweep.report.wording import provenance
from sitl.plant.variant import load_variant
from tests.comparison.pairs import RECORDED, drive, vehicle_file

NOMINAL = load_variant("nominal")
FITTED: dict = {}
ROVER = replace(NOMINAL, friction=1.5, yaw_inertia=0.075)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """(folder, runs, held-out run, model) of a rover that repeats two sweeps and a doublet."""
    folder = tmp_path_factory.mktemp("pair")
    originals = [RECORDED / f"{run}.BIN" for run in ("run1", "run4")]
    paths = drive(ROVER, originals, folder / "recorded", 11)
    vehicle = folder / "rover.toml"
    vehicle.write_text(vehicle_file(ROVER, np.random.default_rng(3)), encoding="utf-8")
    runs = rs.read(str(paths[0]), vehicle=vehicle)
    held = rs.read(str(paths[1]), vehicle=vehicle)
    return folder, paths, runs, held, Diagnosis("none", "", "roll-yaw", model=baseline_model(runs))


def baseline_model(runs):
    """The baseline fitted to the runs, as a diagnosis without findings leaves it."""
    model = Model("roll-yaw", geometry_of(runs.vehicle), Tolerances())
    used = [experiment(run) for run in runs]
    found = fit_with_floor(used, model, {})[1]
    return augmented(model, found.x, list(runs), [run.begin for run in used])


def _answer(recorded, rover, laws=(), seed=50, whole=False):
    """The answer; whole: with bounds and pictures, and the recordings fitted anew."""
    folder, paths, runs, held, diagnosis = recorded
    place = folder / f"sim{seed}"
    simulated = drive(rover, paths, place, seed)
    sims = rs.read(*map(str, simulated), vehicle=folder / "rover.toml")
    fitted = None if whole else FITTED
    return compared(tuple(runs), tuple(held), tuple(sims), diagnosis, laws, fitted=fitted).answer


def test_the_same_rover_agrees(recorded, tmp_path):
    found = _answer(recorded, ROVER, seed=60, whole=True)
    assert found.verdict == "agree", found.sentence
    assert not found.differences
    assert all(a.overall < 1.3 for a in found.agreement)
    assert [a.held_out for a in found.agreement] == [False, True]
    izz = found.could_differ["Izz"]["Izz"]
    assert izz.low is not None
    assert izz.high is not None
    assert -0.1 < izz.low < 0.0 < izz.high < 0.1
    assert {b.run for b in found.bode} == {"recorded-run1"}
    page = write_comparison(found, tmp_path, provenance())
    text = page.read_text(encoding="utf-8")
    assert "agree" in text
    assert text.count("<figure data-chart>") == 2
    assert (tmp_path / "comparison.json").is_file()


def test_each_run_is_compared_at_its_own_noise(recorded):
    """A run on rough ground beside a quiet one: the same rover agrees in both."""
    folder, _, runs, _, _ = recorded

    def driven(name, seed):
        path = drive(ROVER, [RECORDED / f"{name}.BIN"], folder / f"seed{seed}", seed)[0]
        return rs.read(str(path), vehicle=folder / "rover.toml")[0]

    a, b, c, d, e, f = (driven("run3", seed) for seed in range(12, 18))
    pair = (*runs, _rougher(a, b, c))
    sims = (driven("run1", 61), _rougher(d, e, f))
    model = baseline_model(replace(runs, recordings=pair))
    found = compared(pair, (), sims, Diagnosis("none", "", "roll-yaw", model=model), ()).answer
    levels = {(a.run, c): level for a in found.agreement for c, level in a.channels.items()}
    assert len(levels) == 8
    assert levels == pytest.approx(dict.fromkeys(levels, 1.0), abs=0.2)


def _rougher(run, one, other):
    """The run with three times the difference of two others as more noise."""
    own = {
        c: replace(run[c], x=run[c].x + 3.0 * (one[c].on(run[c].t) - other[c].on(run[c].t)))
        for c in ("r", "p", "ay", "vy")
    }
    return replace(run, channels={**run.channels, **own})


@pytest.mark.slow
def test_a_wrong_inertia_is_a_number(recorded):
    found = _answer(recorded, replace(ROVER, yaw_inertia=0.8 * ROVER.yaw_inertia), seed=70)
    assert found.verdict == "differ"
    first, *others = found.differences
    assert (first.name, first.kind) == ("Izz", "number")
    assert first.change["Izz"] == pytest.approx(1.25, rel=0.07)
    assert "too small" in first.sentence
    assert all(d.gain < 0.1 * first.gain for d in others)  # by chance, in 1 of 100
    assert found.places[0].channel in ("r", "ay", "p", "vy")


@pytest.mark.slow
def test_physics_too_much(recorded):
    rover = replace(ROVER, effects={"tyre_relaxation": {"sigma": 0.2}})
    found = _answer(recorded, rover, ("tyre_relaxation",), seed=80)
    (only,) = found.differences
    assert (only.name, only.kind) == ("tyre_relaxation", "too much")
    assert only.simulation[0].value == pytest.approx(0.2, rel=0.1)
    assert only.recordings[0].value < 0.03


@pytest.mark.slow
def test_an_effect_that_no_diagnosis_named(recorded):
    """The recordings' rover steers straight; the simulation's is 8 % stronger to the left."""
    rover = replace(ROVER, effects={"steering_asymmetry": {"e": 0.08}})
    found = _answer(recorded, rover, (), seed=85)
    (only,) = found.differences
    assert (only.name, only.kind) == ("steering_asymmetry", "too much")
    assert only.simulation[0].value == pytest.approx(0.08, abs=0.02)


@pytest.mark.slow
def test_what_begins_in_one_run_of_a_simulation_stays_in_that_run(recorded):
    """Elsewhere it would scale the tyres of every run, and no stiffness could be told from it."""
    rover = replace(ROVER, effects={"surface_change": {"ratio": 0.6, "t": 92.0}})
    found = _answer(recorded, rover, None, seed=95)
    (only,) = found.differences
    assert (only.name, only.kind) == ("surface_change", "too much")
    values = {v.name: v for v in only.simulation}
    assert values["ratio"].value == pytest.approx(0.6, rel=0.06)
    assert values["ratio"].high - values["ratio"].low < 0.1
    assert 30.0 < values["t"].value < 45.0  # at 41 s of the run, or over ten seconds about it


@pytest.mark.slow
def test_another_filter_is_an_instrument(recorded):
    rover = replace(ROVER, velocity_lag=ROVER.velocity_lag + 0.06)
    found = _answer(recorded, rover, seed=90)
    assert [d.kind for d in found.differences] == ["instrument"]
    assert found.differences[0].name == "velocity_lag"


def test_nothing_to_compare(recorded):
    _, _, runs, held, diagnosis = recorded
    with pytest.raises(UsageError, match="no simulated run"):
        rs.compare(runs, (), held_out=held, diagnosis=diagnosis)
    with pytest.raises(DataRefused, match="does not have the steering"):
        compared(tuple(runs), (), tuple(held), diagnosis)


@pytest.mark.slow
@pytest.mark.parametrize("columns", [{}, {"ay": "ay"}])
def test_a_simulator_of_another_kind(recorded, tmp_path, columns):
    """A linear bicycle by Euler's rule, without roll, filters, delay and noise, with Izz 30 % too large.
    Its a_y, where it is given, lacks the part of gravity; the inertia is still found."""
    columns = {"time": "t", "delta": "d", "speed": "V", "r": "r", "axes": "iso", **columns}
    found = _of_bicycle(recorded, tmp_path, columns)
    assert found.verdict == "differ"
    (izz,) = [d for d in found.differences if d.name == "Izz"]
    assert izz.change["Izz"] == pytest.approx(1 / 1.3, rel=0.12)
    assert {d.kind for d in found.differences} <= {"number", "instrument"}
    assert "ay" in columns or "the simulation has no p" in [i.sentence for i in found.instruments]


def _of_bicycle(recorded, folder, columns):
    _, _, runs, _, diagnosis = recorded
    source = folder / "mine.csv"
    _write_bicycle(source, runs[0], 1.3 * ROVER.yaw_inertia)
    sims = rs.read(str(source), vehicle=runs.vehicle_file, columns=columns)
    return compared(tuple(runs), (), tuple(sims), diagnosis, (), fitted={}).answer


def _write_bicycle(path, run, inertia):
    t = np.arange(run.span[0] - 1.5, run.span[1] + 1.5, 0.01)
    speed, delta = np.maximum(run["speed"].on(t), 0.3), run["delta"].on(t)
    m, a, b = ROVER.mass, ROVER.cg_to_front_axle, ROVER.cg_to_rear_axle
    front, rear = ROVER.front_cornering_stiffness, ROVER.rear_cornering_stiffness
    v = r = 0.0
    rows = []
    for now, d, fast in zip(t - t[0], delta, speed, strict=True):
        for step in range(5):
            one, two = front * (d - (v + a * r) / fast), rear * (b * r - v) / fast
            if step == 0:
                rows.append((now, d, fast, r, (one + two) / m))
            v, r = v + 0.002 * ((one + two) / m - fast * r), r + 0.002 * (a * one - b * two) / inertia
    np.savetxt(path, rows, delimiter=",", header="t,d,V,r,ay", comments="")


def test_an_effect_at_the_largest_size_of_a_vehicle_measures_nothing(recorded):
    _, _, runs, _, diagnosis = recorded
    model = common_model(diagnosis.model, ["tyre_speed"])
    side = side_of([experiment(run) for run in runs], model, diagnosis.model.x, ())
    (key,) = (c.name for c in side.coordinates if c.name.startswith("tyre_speed"))
    assert not side.at_largest("tyre_speed")  # absent
    for x, largest in ((-1.5, True), (-1.49, False), (1.5, True)):
        there = replace(side, fitted=replace(side.fitted, x={**side.fitted.x, key: x}))
        assert there.at_largest("tyre_speed") is largest
