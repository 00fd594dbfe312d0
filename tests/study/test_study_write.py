"""The study's folder and its command."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rover_sweep.cli.main import run as command
from rover_sweep.report.wording import strict_json
from rover_sweep.study import published
from rover_sweep.study.study_folder import all_findings, study_document
from rover_sweep.study.virtual_study import Study, drive_all, tables


@pytest.fixture(scope="module")
def written(done: Study, tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """The command on a study that is already there: its folder and exit code."""
    folder = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rover_sweep.study.virtual_study.study", lambda seed, progress: done)
        code = command(["study", "--out", str(folder)])
    return SimpleNamespace(folder=folder, code=code)


def test_the_command_writes_page_document_and_the_papers_figures(written: SimpleNamespace) -> None:
    assert written.code == 0
    figures = {path.name for path in (written.folder / "figures").iterdir()}
    names = ("2", "3", "6", "6-filters-known", "7", "8a", "8b")
    assert figures == {f"figure-{n}.svg" for n in names}
    document = json.loads((written.folder / "study.json").read_text())
    assert set(document["practices"]) == {"paper", "known", "default"}
    assert document["findings"]["fast"]["outcome"] == "came out"


def test_the_page_needs_nothing_else(written: SimpleNamespace, done: Study) -> None:
    page = (written.folder / "study.html").read_text()
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
    again = drive_all(1, lambda share, what: None)
    for first, second in zip(
        (*done.runs.sweeps, *done.runs.checks.values()), (*again.sweeps, *again.checks.values()), strict=True
    ):
        assert all(np.array_equal(first[c].x, second[c].x) for c in first.channels)
    sweeps = done.runs.sweeps
    assert not np.array_equal(sweeps[0]["r"].x, sweeps[1]["r"].x)


def test_a_negative_seed_is_a_usage_error(tmp_path: Path) -> None:
    assert command(["study", "--out", str(tmp_path), "--seed", "-1"]) == 2
