"""The model of a diagnosis as a simulated rover: the plant drives as the model says.

The two share no code; what differs beyond the translation is named where a case is given more room.
"""

from __future__ import annotations

import tempfile
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from augmented_models import RUN, model, on_smooth_ground, recording

import rover_sweep as rs
from rover_sweep.data.recording import Recording
from rover_sweep.diagnosis.effects import every_form, form_named
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.diagnosis.simulation.table_law import TableLaw, resonator
from rover_sweep.logs.read import read_logs, read_runs
from rover_sweep.redrive.recorded_course import course_of, on_the_clock
from rover_sweep.report.export.augmented_model_json import augmented_document, augmented_from
from rover_sweep.report.export.plant_variant import not_in_the_plant, variant_text
from sitl.plant.effects.replaced_numbers import resolved
from sitl.plant.effects.steering_effects import Linkage
from sitl.plant.plant_law import table_laws
from sitl.plant.tyre import lateral_force
from sitl.plant.variant import load_variant
from sitl.plant.variant_text import variant_text as plant_text
from sitl.redrive.course import Course
from sitl.redrive.open_loop import redrive

CHANNELS = ("r", "ay", "p", "vy")
# {effect: (channel it is judged by, largest share of it that the plant may do otherwise)}
JUDGED = {
    "servo_lag": ("r", 0.1),
    "transport_delay": ("r", 0.1),
    "servo_rate_limit": ("r", 0.2),
    "steering_trim": ("r", 0.1),
    "steering_scale": ("r", 0.1),
    "tyre_relaxation": ("r", 0.1),
    "front_rear_stiffness": ("r", 0.1),
    "roll_steer": ("r", 0.1),
    "imu_offset": ("ay", 0.1),
    "imu_tilt": ("p", 0.1),
    "sensor_filter": ("r", 0.1),
    "velocity_lag": ("vy", 0.1),
    "surface_change": ("vy", 0.1),
    "tyre_saturation": ("vy", 0.2),
    "load_transfer": ("vy", 0.2),
    "tyre_speed": ("vy", 0.2),
    "cross_slope": ("ay", 0.2),  # the plant leans when it starts, the model begins upright
    "suspension_friction": ("p", 0.45),  # dry friction is rounded otherwise about rest
    "servo_lag/second order": ("r", 0.1),
    "steering_compliance": ("r", 0.1),
    "tyre_saturation/brush": ("vy", 0.2),
    "tyre_saturation/falling peak": ("vy", 0.2),
    "roll_steer/rear axle": ("r", 0.1),
    "yaw_damping": ("r", 0.1),
    "yaw_damping/over r/V": ("r", 0.1),
    "side_wind": ("ay", 0.2),
    "sensor_scale": ("ay", 0.1),
    "sensor_filter/first order": ("r", 0.1),
    "sensor_filter/delay": ("r", 0.1),
    "sensor_filter/first order, before the estimator": ("vy", 0.2),
    "sensor_filter/second order, before the estimator": ("vy", 0.2),
}
OTHERWISE = {"servo_lag/second order": {"q"}, "surface_change/one run": {"t"}}  # beside those of a report
FIRST_IN_THE_PLANT = {"surface_change/from then on", "surface_change/one run"}
BANDS = tuple(1.0 + 0.12 * ((2 * k + 1) / 16 - 1.0) for k in range(16))  # of `jumps` and `sticks`
INSTANT = 6.5  # s after the start of the manoeuvre


def simulated(whole: AugmentedModel) -> Mapping[str, np.ndarray]:
    return rs.simulate(whole, recording()).signals


@cache
def course() -> Course:
    (log,) = read_logs(str(RUN))
    return course_of(log)


def recorded(whole: AugmentedModel, folder: Path) -> Recording:
    """What the plant with that variant records on smooth ground."""
    no_wait = replace(whole, wait=0.0)  # a log's commands stand where the servo got them
    path, out = on_smooth_ground(variant_text(no_wait), folder), folder / "out.BIN"
    redrive(course(), on_the_clock(load_variant(path), [recording()]), out)
    (run,) = read_runs(str(out))
    return run


def driven(whole: AugmentedModel, folder: Path) -> Mapping[str, np.ndarray]:
    """Channels of that recording at the times of the simulation."""
    run, t = recorded(whole, folder), rs.simulate(whole, recording()).t
    return {c: run[c].on(t) for c in CHANNELS if c in run}


@cache
def plain() -> tuple[Mapping[str, np.ndarray], Mapping[str, np.ndarray]]:
    """Without any effect: (by the model, by the plant)."""
    with tempfile.TemporaryDirectory() as folder:
        return simulated(model()), driven(model(), Path(folder))


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x[300:-300] ** 2)))


def test_the_plain_model_is_driven_as_simulated() -> None:
    by_model, by_plant = plain()
    errors = {c: rms(by_plant[c] - by_model[c]) / rms(by_model[c]) for c in CHANNELS}
    assert max(errors[c] for c in ("r", "ay")) < 0.03 and max(errors.values()) < 0.08, errors


@pytest.mark.parametrize("effect", JUDGED)
def test_an_effect_does_in_the_plant_what_it_does_in_the_model(effect: str, tmp_path: Path) -> None:
    whole = model(effect)
    if effect == "surface_change":
        begin = rs.simulate(whole, recording()).t[0] - recording().span[0]
        own = {**whole.x, "surface_change.t": INSTANT - begin}
        whole = replace(whole, x=own, happened_in="run4", happened_at=INSTANT)
    (channel, room), (model_without, plant_without) = JUDGED[effect], plain()
    wanted = simulated(whole)[channel] - model_without[channel]
    done = driven(whole, tmp_path)[channel] - plant_without[channel]
    assert rms(wanted) > 0.004 * rms(model_without[channel])  # there is something to reproduce
    assert rms(done - wanted) < room * rms(wanted)


@pytest.mark.parametrize(
    ("law", "sizes", "share"),
    [
        ("steering_deadband/full travel", (1.0,), 0.2),  # a jump in the plant, a steep ramp in the model
        ("steering_stiction", BANDS, 1e-6),  # the model is the mean of bands
        ("steering_stiction/with memory", BANDS, 1e-6),
        ("steering_deadband", (1.0,), 1e-6),
        ("steering_nonlinearity", (1.0,), 1e-6),
        ("steering_nonlinearity/quadratic", (1.0,), 1e-6),
        ("steering_asymmetry", (1.0,), 1e-6),
        ("steering_backlash", (1.0,), 1e-6),
        ("steering_backlash/smooth hysteresis", (1.0,), 0.02),
    ],
)
def test_laws_of_the_command_are_the_same_in_the_plant(
    law: str, sizes: tuple[float, ...], share: float
) -> None:
    """A doublet does not show them: a command of two sines, angle by angle."""
    t = np.arange(0.0, 10.0, 0.005)
    u = 0.05 * np.sin(4.0 * t) + 0.02 * np.sin(11.0 * t)
    whole, effect = model(law), form_named(law)
    wanted = effect.act(u, effect.coordinates(whole.x))  # type: ignore[attr-defined]
    (name,) = (effect.key(p.name) for p in effect.parameters)
    each = [replace(whole, x={**whole.x, name: size * whole.x[name]}) for size in sizes]
    plants = [Linkage(tomllib.loads(variant_text(one))["effects"]) for one in each]
    done = np.array([np.mean([plant.played(plant.wanted(float(angle))) for plant in plants]) for angle in u])
    assert np.sqrt(np.mean((wanted - u) ** 2)) > 0.0003
    assert np.sqrt(np.mean((done - wanted) ** 2)) <= share * np.sqrt(np.mean((wanted - u) ** 2))


def test_every_effect_of_the_library_has_a_place_in_the_plant(tmp_path: Path) -> None:
    for name, law in every_form().items():
        effect = law.id
        text = variant_text(replace(model(name), happened_in="run4", happened_at=1.0))
        path = tmp_path / "variant.toml"
        path.write_text(text)
        parameters, table = load_variant(path), tomllib.loads(text).get("effects", {})
        assert resolved(parameters).steering_trim_us == 1500
        if effect in ("tyre_slip", "roll_dof", "front_rear_stiffness"):
            assert effect not in table  # numbers that every plant has
            continue
        reported = set(model(name).reported(form_named(name))) | OTHERWISE.get(name, set())
        known = {"k" if n == "kC" else n for n in reported}
        assert {k for k in table[effect] if k not in ("of", "run", "form")} == known, text
        assert table[effect].get("form", law.form) == law.form or name in FIRST_IN_THE_PLANT
        assert "form" in table[effect] or law.first or name in FIRST_IN_THE_PLANT
    assert table is not None


def test_numbers_of_a_form_are_in_the_units_of_the_plant() -> None:
    soft, damped = model("steering_compliance"), model("yaw_damping")
    table = tomllib.loads(variant_text(soft))
    assert table["effects"]["steering_compliance"]["k"] * table["front_cornering_stiffness"] == pytest.approx(
        0.3, rel=1e-5
    )
    inertia = damped.rover.yaw_inertia or damped.rover.mass * damped.rover.a * damped.rover.b
    table = tomllib.loads(variant_text(damped))
    assert table["effects"]["yaw_damping"]["c"] == pytest.approx(3.0 * inertia, rel=1e-5)


def test_a_clock_offset_is_the_stamps_and_leaves_the_usual_delay_to_the_rover() -> None:
    table = tomllib.loads(variant_text(model("clock_offset")))
    assert table["effects"]["clock_offset"]["T"] == pytest.approx(0.06)
    assert table["servo_delay"] == pytest.approx(0.015)  # of 20 ms, 5 are the wait for the main loop


def test_plant_and_model_mean_the_same_by_a_late_clock(tmp_path: Path) -> None:
    """The recording of a steering that is stamped 60 ms late is explained by it, and not by the opposite."""
    offset, run = model("clock_offset"), recorded(model("clock_offset"), tmp_path)
    right, none = rs.simulate(offset, run), rs.simulate(model(), run)
    wrong = rs.simulate(model("clock_offset", delay=0.08), run)
    assert right.error("r") < 0.05 * rms(right.measured["r"])
    assert 4 * right.error("r") < none.error("r") < wrong.error("r")


@pytest.mark.parametrize("baseline", ["kinematic", "bicycle"])
def test_models_without_tyres_or_roll_are_driven_as_near_as_the_plant_can(
    baseline: str, tmp_path: Path
) -> None:
    whole = model(baseline=baseline)
    wanted, done = simulated(whole), driven(whole, tmp_path)
    assert rms(done["r"] - wanted["r"]) < (0.12 if baseline == "kinematic" else 0.03) * rms(wanted["r"])
    assert "p" not in done  # readers leave out what stands still
    assert any("does not roll" in words for words in not_in_the_plant(whole))


def test_derivatives_are_no_rover() -> None:
    with pytest.raises(rs.UsageError, match="diagnose with --baseline roll-yaw"):
        variant_text(model(baseline="lumped"))


def test_what_the_plant_cannot_be_is_said_in_the_file() -> None:
    text = variant_text(model("tyre_relaxation", vscale=0.012, ay_lag=0.002, vy_gain=-0.05, lag_shape=0.2))
    remarks = [line for line in text.splitlines() if line.startswith("#")]
    for words in ("1.0120 times", "ay by 2.0 ms", "0.950 times", "second order"):
        assert any(words in line for line in remarks), words
    assert not_in_the_plant(model("tyre_saturation")) == []


def test_tyres_that_bend_in_the_model_do_so_in_the_plant(tmp_path: Path) -> None:
    """Half of the load is the force at which both laws lose as much."""
    whole = model(bend=0.7)
    (tmp_path / "v.toml").write_text(variant_text(whole))
    parameters = load_variant(tmp_path / "v.toml")
    lost = 1 - lateral_force(-0.5, 1.0, parameters.friction, parameters.tyre_shape) / 0.5
    assert lost == pytest.approx(0.7 * 0.5**4 / 4, rel=0.1)


# ---- A law without a name in the variant file.

LAWS = {
    "steering with play": TableLaw("steering", "delta", (-0.3, 0.3), (0.1, -0.1), memory="play", size=0.03),
    "yaw moment": TableLaw("yaw moment", "r", (-2.0, 0.0, 2.0), (1.4, 0.0, -1.4)),
    "side force rear": TableLaw("side force rear", "v", (1.0, 3.0), (0.2, 0.6), "a_y"),
    "swinging load": replace(resonator("side force", "a_y", 1.4, 0.2), y=(0.25, 0.05)),
    "soft linkage": replace(resonator("steering", "delta", 4.0, 0.3), y=(0.1, 0.0)),
}


@pytest.mark.parametrize("name", LAWS)
def test_a_law_does_in_the_plant_what_it_does_in_the_model(name: str, tmp_path: Path) -> None:
    whole = replace(model(), laws=(LAWS[name],))
    model_without, plant_without = plain()
    wanted = simulated(whole)["r"] - model_without["r"]
    done = driven(whole, tmp_path)["r"] - plant_without["r"]
    assert rms(wanted) > 0.01 * rms(model_without["r"])  # there is something to reproduce
    assert rms(done - wanted) < 0.12 * rms(wanted)


def test_a_law_that_the_plant_lacks_is_a_sentence(tmp_path: Path) -> None:
    text = variant_text(replace(model(), laws=(TableLaw("sensor of r", "signal", (0.0, 1.0), (0.0, 0.1)),)))
    assert "# The law at the sensor of r over signal is not included" in text
    path = tmp_path / "a.toml"
    path.write_text(text)
    assert load_variant(path).laws == ()


def test_a_variant_with_laws_is_written_and_read_again(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text(variant_text(replace(model(), laws=tuple(LAWS.values()))))
    first = load_variant(path)
    assert [law.place for law in first.laws] == [law.place for law in LAWS.values()]
    path.write_text(plant_text(first))
    assert load_variant(path) == first


def test_a_model_with_laws_survives_its_document() -> None:
    whole = replace(model(), laws=tuple(LAWS.values()))
    again = augmented_from(augmented_document(whole))
    assert again.laws == whole.laws and "laws at the yaw moment" in again.name
    still = {**vars(LAWS["swinging load"]), "damping": 0.0}
    with pytest.raises(ValueError, match="damping above 0"):
        augmented_from({**augmented_document(whole), "laws": [still]})
    moon = {**vars(LAWS["steering with play"]), "place": "moon"}
    with pytest.raises(ValueError, match="no place"):
        augmented_from({**augmented_document(whole), "laws": [moon]})


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"place": "moon"}, "place"),
        ({"x": [1.0, 0.0]}, "ascend"),
        ({"x": [0.0]}, "list of 2"),
        ({"y": [0.0, float("nan")]}, "finite"),
        ({"play": -1.0}, "play"),
        ({"frequency": 1.4}, "damping above 0"),
        ({"frequency": 30.0, "damping": 0.1}, "up to 20 Hz"),
        ({"damping": 0.1}, "resonator"),
        ({"frequency": 1.4, "damping": 0.1, "play": 0.1}, "no factor or play"),
        ({"colour": 1}, "has no colour"),
    ],
)
def test_a_wrong_table_is_refused_with_its_name(change: dict[str, object], why: str) -> None:
    good = {"place": "steering", "over": "delta", "x": [0.0, 1.0], "y": [0.0, 0.1]}
    assert table_laws([good], "a.toml")[0].y == (0.0, 0.1)
    with pytest.raises(ValueError, match=why):
        table_laws([{**good, **change}], "a.toml")
