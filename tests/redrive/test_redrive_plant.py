"""A recording of the real firmware driven again through the plant: the same motion, the same parameters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rover_sweep.api.read import Reading, load_steered
from rover_sweep.cli.main import run
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import load as load_vehicle
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.identification.grouping import Settings
from rover_sweep.identification.pipeline import Identification, identify
from rover_sweep.logs.read import read_runs


@pytest.fixture(scope="module")
def again(data: Path, truth: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("redrive") / "again.BIN"
    source = data / "ardurover-4.6.3" / "nominal" / "run1.BIN"
    assert run(["redrive", str(source), "--variant", str(truth), "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def both(data: Path, again: Path) -> tuple[Recording, Recording]:
    (field,), (simulated,) = read_runs(str(data / "ardurover-4.6.3/nominal/run1.BIN")), read_runs(str(again))
    return field, simulated


def test_the_recording_is_on_the_clock_of_the_log(both: tuple[Recording, Recording]) -> None:
    field, simulated = both
    assert simulated.span == pytest.approx(field.span, abs=1e-6)
    assert (simulated.kind, simulated.filters) == (field.kind, field.filters)
    t = np.arange(*field.span, 0.01)
    assert simulated["pwm"].on(t) == pytest.approx(field["pwm"].on(t), abs=1.001)  # 1 us, rounded
    assert abs(simulated.mean_speed - field.mean_speed) < 0.005


@pytest.mark.parametrize("channel", ["r", "ay"])
def test_responses_agree_within_the_noise_of_both(both: tuple[Recording, Recording], channel: str) -> None:
    """The noise of straight driving, of both recordings together, and 3 % of the response itself: the
    estimator's speed, which is followed, is 1.4 % lower than the true one of that recording."""
    field, simulated = both
    t = np.arange(*field.span, 0.01)
    difference = np.std(field[channel].on(t) - simulated[channel].on(t))
    noise = [
        np.mean([np.std(one[channel].between(*part).x) for part in one.straight])
        for one in (field, simulated)
    ]
    signal = np.std(field[channel].on(t))
    assert difference < np.hypot(1.15 * np.hypot(*noise), 0.03 * signal)
    assert difference < 0.25 * signal, "and it is not all noise"


def identified(source: Path, data: Path) -> Identification:
    """One C for both axles in both: with the axles apart in one of them alone, C is another quantity."""
    vehicle = load_vehicle(data / "rover.toml")
    runs = load_steered([str(source)], vehicle, Reading())
    return identify(runs, geometry_of(vehicle), settings=Settings(models=("roll-yaw",), as_paper=True))


def test_identification_gives_the_same_parameters(data: Path, again: Path) -> None:
    """Within the Cramer-Rao bound of the recording: another noise moves Izz by 4 % (standard deviation)."""
    field, simulated = (
        identified(source, data).models["roll-yaw"].fit
        for source in (data / "ardurover-4.6.3/nominal/run1.BIN", again)
    )
    for name in ("C", "Izz", "k_phi", "tau"):
        bound = 0.01 * (field[name].cr_percent or 0.0)
        assert 0.0 < bound < 0.13, name
        assert simulated[name].value == pytest.approx(field[name].value, rel=bound), name
