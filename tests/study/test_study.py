"""The study on virtual rovers: the printed tables, the drive, the findings, and what is written."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rover_sweep.cli.main import run as command
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import MODELS
from rover_sweep.manoeuvre.sweep import Doublet
from rover_sweep.report.wording import strict_json
from rover_sweep.study import findings, published
from rover_sweep.study.published import Firmware, virtual_drive
from rover_sweep.study.study_folder import all_findings, outcome_counts, study_document
from rover_sweep.study.virtual_study import Study, drive_all, tables
from sitl.plant.variant import load_variant


@pytest.mark.parametrize("model", MODELS)
def test_printed_averages_are_those_of_their_columns_and_bounds_are_twice_the_insensitivity(
    model: str,
) -> None:
    """CR/I >= 2 by equations (13) and (14)."""
    column = {o: j for o, j in published.COSTS[model].items() if o != "average"}
    assert np.mean(list(column.values())) == pytest.approx(published.COSTS[model]["average"], abs=0.06)
    assert ("p" in column) == (model != "bicycle")
    free = [p for p in published.PARAMETERS[model].values() if p.free]
    assert free and all(p.cr >= 2 * p.insensitivity for p in free)  # type: ignore[operator]


def test_table_4_has_fifteen_derivatives_and_a_delay_and_tables_6_and_7_nine_checks() -> None:
    rows = published.PARAMETERS["lumped"]
    assert len(rows) == 16
    assert {n for n, p in rows.items() if not p.free} == {"Y_v", "Y_r", "Y_phi", "L_v", "L_phi"}
    checks = [v for check in published.VERIFICATION.values() for v in check.values()]
    assert len(checks) == 9 and all(0 < v.tic < 1 and v.j_rms > 0 for v in checks)


# ---- A run of the virtual rover: axes, rates, filters, the wave, repeatability.

SHORT = Doublet(amplitude=100.0, pulse=1.0, pause=1.0, count=1, straight=1.0)
ROVER = load_variant("paper_asphalt")


@pytest.fixture(scope="module")
def run() -> Recording:
    return virtual_drive("doublet", ROVER, SHORT, 2.4, seed=3)


def test_a_larger_pwm_turns_right_which_is_negative_in_iso_axes(run: Recording) -> None:
    start, _ = run.span
    first = run["r"].between(start + 1.6, start + 2.0).x  # +100 us
    second = run["r"].between(start + 2.6, start + 3.0).x  # -100 us
    assert first.mean() < -0.3 and second.mean() > 0.3
    assert run["ay"].between(start + 1.6, start + 2.0).x.mean() < -0.5
    assert run["delta"].between(start + 1.6, start + 1.97).x.mean() == pytest.approx(-0.094, rel=0.02)
    assert run["psi"].between(start + 1.0, start + 2.0).x[-1] < run["psi"].between(start, start + 1.0).x[0]


def test_the_wave_is_the_applets_held_between_main_loops(run: Recording) -> None:
    pwm, (start, end) = run["pwm"], run.span
    assert pwm.hold and pwm.rate == pytest.approx(50)
    inside = pwm.between(start, end)
    assert np.max(np.abs(inside.x - 1500 - SHORT.wave(inside.t - start))) <= 0.5
    assert np.all(pwm.between(end + 0.1, end + 3).x == 1500)


def test_speed_comes_from_the_throttle_and_is_lost_in_corners(run: Recording) -> None:
    start, _ = run.span
    assert run["speed"].between(start - 0.5, start + 1.0).x.mean() == pytest.approx(2.4, abs=0.05)
    assert run.mean_speed < 2.4
    assert abs(run.bias("r") or 1.0) < 0.005


def test_the_firmwares_filters_are_in_the_signals_and_in_the_recording(run: Recording) -> None:
    assert {c: f.cutoff_hz for c, f in run.filters.items()} == {"r": 4.0, "p": 4.0, "ay": 10.0}
    open_filters = virtual_drive(
        "open", ROVER, SHORT, 2.4, 3, Firmware(gyro_filter_hz=100.0, accel_filter_hz=100.0)
    )
    assert np.std(np.diff(open_filters["p"].x)) > 2 * np.std(np.diff(run["p"].x))


def test_the_same_seed_drives_the_same_run_and_another_another(run: Recording) -> None:
    again, other = (virtual_drive("doublet", ROVER, SHORT, 2.4, seed) for seed in (3, 4))
    assert all(np.array_equal(run[c].x, again[c].x) for c in run.channels)
    assert not np.array_equal(run["r"].x, other["r"].x)


def test_the_loop_must_divide_the_physics_rate() -> None:
    with pytest.raises(ValueError, match="loop_hz = 60"):
        Firmware(loop_hz=60)


def test_the_asphalt_variant_keeps_table_3_and_its_mean_stiffness() -> None:
    published = load_variant("paper")
    assert (ROVER.front_cornering_stiffness + ROVER.rear_cornering_stiffness) / 2 == pytest.approx(
        published.front_cornering_stiffness, abs=0.02
    )
    assert (ROVER.yaw_inertia, ROVER.roll_stiffness) == (published.yaw_inertia, published.roll_stiffness)
    grass = load_variant("paper_grass")
    assert grass.friction < ROVER.friction and grass.road_force > ROVER.road_force


# ---- Findings of the study against the numbers of the virtual rover; its texts follow the numbers.


def swapped(done: Study, first: str, second: str) -> Study:
    """The study with two models' results exchanged in the fits made as the paper made them."""
    paper = done.paper
    models = dict(paper.result.models)
    models[first], models[second] = models[second], models[first]
    result = replace(paper.result, models=models)
    return replace(done, practices={**done.practices, "paper": replace(paper, result=result)})


def test_the_lumped_model_does_not_carry_to_another_speed_and_the_roll_yaw_does(done: Study) -> None:
    for practice in done.practices.values():
        nominal, fast = (
            {m: practice.check(m, c).tic for m in ("roll-yaw", "lumped")} for c in ("asphalt", "fast")
        )
        assert nominal["lumped"] < 0.1
        assert fast["lumped"] > 0.25 > 2 * fast["roll-yaw"]
    assert findings.fast(done).outcome == "came out"
    # its cause is V in the kinematic term alone
    assert done.counterfactuals.frozen.tic > 2 * done.known.check("roll-yaw", "fast").tic


def test_ignoring_the_filters_costs_delay_and_cost(done: Study) -> None:
    for model in ("bicycle", "roll-yaw", "lumped"):
        paper, known = done.paper.fit(model), done.known.fit(model)
        assert 0.02 < paper["tau"].value - known["tau"].value < 0.056
        assert paper.average > 3 * known.average
    assert done.known.fit("roll-yaw")["tau"].value == pytest.approx(0.037, abs=0.004)


def test_known_filters_and_no_estimator_velocity_give_the_rover_back(done: Study) -> None:
    fit = done.practices["default"].fit("roll-yaw")
    true = done.truth.values
    for name, tolerance in (("k_phi", 0.06), ("b_phi", 0.06), ("Izz", 0.2)):
        assert fit[name].value == pytest.approx(true[name], rel=tolerance)
    assert fit["C"].value == pytest.approx((true["Cf"] + true["Cr"]) / 2, rel=0.04)


def test_the_estimators_lag_is_what_moves_izz_and_every_model_is_stable(done: Study) -> None:
    true = done.truth.values["Izz"]
    assert done.known.fit("roll-yaw")["Izz"].value < 0.85 * true
    assert done.counterfactuals.prompt["Izz"].value == pytest.approx(true, rel=0.1)
    for practice in done.practices.values():
        for model in ("bicycle", "roll-yaw", "lumped"):
            assert practice.fit(model).structure.poles(practice.group.speed).real.max() < 1e-3


def test_outcomes_follow_the_numbers(done: Study) -> None:
    assert findings.cost_order(done).outcome == "came out"
    assert findings.cost_order(swapped(done, "lumped", "bicycle")).outcome != "came out"
    assert findings.nominal(done).outcome == "did not come out"
    assert findings.nominal(swapped(done, "lumped", "roll-yaw")).outcome == "came out"
    assert findings.fast(swapped(done, "lumped", "roll-yaw")).outcome == "did not come out"


def test_words_carry_the_numbers_they_are_about_and_the_summary_counts(done: Study) -> None:
    paper, known = (p.fit("roll-yaw")["tau"].value for p in (done.paper, done.known))
    text = findings.delays(done).text
    assert f"roll-yaw {1000 * paper:.0f} ms" in text and f"roll-yaw {1000 * known:.0f} ms" in text
    assert f"{done.paper.fit('lumped').average:.1f}" in findings.cost_order(done).text
    found = all_findings(done)
    assert len({f.key for f in found}) == len(found)
    assert outcome_counts(found).startswith(f"{sum(f.outcome == 'came out' for f in found)} of {len(found)} ")


# ---- The study's folder and its command.


@pytest.fixture(scope="module")
def written(done: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the command on a study that is already there."""
    folder = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rover_sweep.study.virtual_study.study", lambda seed, progress: done)
        assert command(["study", "--out", str(folder)]) == 0
    return folder


def test_the_command_writes_page_document_and_the_papers_figures(written: Path) -> None:
    figures = {path.name for path in (written / "figures").iterdir()}
    names = ("2", "3", "6", "6-filters-known", "7", "8a", "8b")
    assert figures == {f"figure-{n}.svg" for n in names}
    document = json.loads((written / "study.json").read_text())
    assert set(document["practices"]) == {"paper", "known", "default"}
    assert document["findings"]["fast"]["outcome"] == "came out"


def test_the_page_needs_nothing_else(written: Path, done: Study) -> None:
    page = (written / "study.html").read_text()
    sources = re.findall(r'(?:src|href)="([^"]{0,40})', page)
    assert sources and all(s.startswith("#") and f'id="{s[1:]}"' in page for s in sources)
    assert page.count("<figure data-chart>") == 7
    assert all(f"Table {n}" in page for n in range(2, 8))
    assert all(f.outcome in page for f in all_findings(done))


def test_tables_hold_the_published_numbers_beside_ours(done: Study) -> None:
    bicycle, roll_yaw, lumped, costs, nominal, *_ = tables(done)
    cells = {row[0].text: [c.text for c in row] for row in roll_yaw.rows}
    assert cells["I_zz"][2] == "0.056" and cells["I_zz"][3] == "8.10"
    assert float(cells["I_zz"][5]) == pytest.approx(done.paper.fit("roll-yaw")["Izz"].value, rel=1e-3)
    assert len(lumped.rows) == 16 and len(bicycle.rows) == 3
    averages = [[c.text for c in row] for row in costs.rows if row[0].text == "J_ave"]
    assert averages == [["J_ave", "published", "84.2", "63.3", "22.1"]]
    assert [c.text for c in nominal.rows[0]][2:] == ["0.18", "0.10", "0.17"]


def test_the_document_carries_every_printed_value(done: Study) -> None:
    document = json.loads(strict_json(study_document(done, all_findings(done))))
    printed = document["published"]["parameters"]
    assert printed["lumped"]["N_r"]["value"] == published.PARAMETERS["lumped"]["N_r"].value
    model = document["practices"]["paper"]["models"]["roll-yaw"]
    assert model["cost"]["average"] == pytest.approx(done.paper.fit("roll-yaw").average)
    assert model["verification"]["fast"]["tic"] == pytest.approx(done.paper.check("roll-yaw", "fast").tic)


def test_the_same_seed_drives_the_same_plan(done: Study) -> None:
    again = drive_all(1, lambda step, share: None)
    for first, second in zip(
        (*done.runs.sweeps, *done.runs.checks.values()), (*again.sweeps, *again.checks.values()), strict=True
    ):
        assert all(np.array_equal(first[c].x, second[c].x) for c in first.channels)
    sweeps = done.runs.sweeps
    assert not np.array_equal(sweeps[0]["r"].x, sweeps[1]["r"].x)


def test_a_negative_seed_is_a_usage_error(tmp_path: Path) -> None:
    assert command(["study", "--out", str(tmp_path), "--seed", "-1"]) == 2
