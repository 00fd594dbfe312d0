"""The printed intervals hold the truth of a simulated rover, whose laws the identification does not know."""

import tempfile
from dataclasses import replace
from pathlib import Path

import pytest

from rover_sweep.identification.bootstrap import stiffness_loss, with_intervals, with_structural_error
from rover_sweep.identification.grouping import Settings
from tests.benchmarks.interval_coverage import handling_checked, identified, parameters_checked, rover_named

pytestmark = pytest.mark.slow

SEEDS = (501, 502)  # of the benchmark's, in which 9 or 10 of 10 held each truth


@pytest.fixture(scope="module")
def found():
    rover = rover_named("nominal")
    with tempfile.TemporaryDirectory() as folder:
        return rover, [identified(rover, seed, Path(folder) / str(seed)) for seed in SEEDS]


def test_the_true_parameters_are_inside(found):
    rover, results = found
    for result in results:
        assert result.recommended == "roll-yaw"
        rows = {row.name: row for row in parameters_checked(result, rover)}
        assert set(rows) == {"Cf", "Cr", "Izz", "k_phi", "b_phi", "tau"}
        assert [name for name, row in rows.items() if not row.inside] == []
        assert not rows["Cf"].inside_noise and not rows["Cr"].inside_noise  # why they are wider


def test_the_intervals_are_still_of_use(found):
    rover, results = found
    for row in (row for result in results for row in parameters_checked(result, rover)):
        low, high = row.printed
        assert low <= row.value <= high and (high - low) / 2 < 0.15 * row.true, row.name


def test_the_true_handling_is_inside(found):
    rover, results = found
    rows = [row for result in results for row in handling_checked(result, rover)]
    assert len(rows) >= 16
    assert [row.name for row in rows if not row.inside] == []


def test_the_fit_of_the_paper_keeps_the_intervals_of_the_noise(found):
    rover, (result, _) = found
    settings = replace(result.settings, as_paper=True)
    model = {"roll-yaw": result.models["roll-yaw"]}
    plain = with_intervals(model, result.groups, settings)["roll-yaw"].parameters
    for row in parameters_checked(result, rover):
        assert plain[row.name].interval_90 == pytest.approx(row.noise)


def test_grip_lets_the_stiffness_lose_less(found):
    runs = [run for g in found[1][0].groups for run in g.runs]
    slippery, unknown, grippy = (stiffness_loss(runs, mu) for mu in (0.2, None, 0.9))
    assert slippery == pytest.approx(0.25, abs=0.03) and slippery > unknown > grippy > 0.03


def test_a_fit_without_intervals_or_tyres_stays(found):
    result = found[1][0]
    conditions = [g.condition(Settings().fitted) for g in result.groups]
    for fit in (result.models["kinematic"].fit, result.models["roll-yaw"].variants["Cf and Cr free"]):
        assert with_structural_error(fit, conditions, 0.1) is fit
