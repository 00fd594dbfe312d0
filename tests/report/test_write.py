"""The report folder."""

from __future__ import annotations

import csv
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rover_sweep.errors import UsageError
from rover_sweep.files.documents import write_file
from rover_sweep.report.identification.identification_json import identification_document
from rover_sweep.report.identification.report import write_report


def names(folder: Path) -> set[str]:
    return {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}


def test_folder_holds_document_page_pictures_and_models(reports: dict[str, Path], nominal: Any) -> None:
    assert names(reports["nominal"]) == {
        "identification.json",
        "report.html",
        "responses.csv",
        "pictures/verification-run4.svg",
        "pictures/models.svg",
        "pictures/errors.svg",
        "pictures/history-run1.svg",
        "pictures/history-run2.svg",
        "pictures/history-run4.svg",
        "models/kinematic.json",
        "models/bicycle.json",
        "models/roll-yaw.json",
        "models/lumped.json",
    }
    told = json.loads((reports["nominal"] / "identification.json").read_text(encoding="utf-8"))
    assert told == json.loads(json.dumps(identification_document(*nominal)))


def test_the_measured_responses_are_a_table(reports: dict[str, Path], nominal: Any) -> None:
    rows = list(csv.DictReader((reports["nominal"] / "responses.csv").read_text().splitlines()))
    r = nominal.result.groups[0].responses["r"]
    own = [row for row in rows if row["output"] == "r"]
    assert {row["output"] for row in rows} == set(nominal.result.groups[0].responses)
    np.testing.assert_allclose([float(row["w_rad_s"]) for row in own], r.w, rtol=1e-5)
    np.testing.assert_allclose(
        [float(row["magnitude_db"]) for row in own], r.magnitude_db, rtol=1e-4, atol=1e-5
    )
    usable = [float(row["w_rad_s"]) for row in own if row["usable"] == "1"]
    assert (usable[0], usable[-1]) == pytest.approx(r.band, rel=0.1)


def test_a_rejected_model_is_not_exported(reports: dict[str, Path]) -> None:
    assert [p.name for p in (reports["stock"] / "models").iterdir()] == ["kinematic.json"]


def test_writing_again_removes_what_is_no_longer_true_tells_its_progress_and_keeps_other_files(
    stock: Any, tmp_path: Path
) -> None:
    for stale in ("models/bicycle.json", "pictures/old.svg"):
        (tmp_path / stale).parent.mkdir()
        (tmp_path / stale).write_text("old")
    (tmp_path / "notes.txt").write_text("mine")
    told: list[tuple[str, float]] = []
    files = write_report(
        stock.result, tmp_path, stock.provenance, lambda step, share: told.append((step, share))
    )
    found = names(tmp_path)
    assert "models/bicycle.json" not in found and "pictures/old.svg" not in found and "notes.txt" in found
    shares = [share for _, share in told]
    assert shares == sorted(shares) and shares[0] == 0 and shares[-1] == 1
    written = (files.document, files.page, files.responses, *files.pictures, *files.models)
    assert {str(p.relative_to(tmp_path)) for p in written} == (found - {"notes.txt"})


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "identification.json"
    write_file(path, "old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(UsageError, match="No space left on device"):
        write_file(path, "new")
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_a_place_that_is_no_folder_is_a_usage_error(stock: Any, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="cannot be written"):
        write_report(stock.result, tmp_path / "file", stock.provenance)


def test_runs_that_carry_no_model_still_make_a_report_that_says_so(nominal: Any, tmp_path: Path) -> None:
    why = "nothing can be identified: the yaw rate follows the steering in no frequency band"
    nothing = replace(nominal.result, models={}, refused={"bicycle": why}, recommended=None, summary=(why,))
    files = write_report(nothing, tmp_path, nominal.provenance)
    told = json.loads(files.document.read_text(encoding="utf-8"))
    assert (told["models"], told["recommended"], files.models) == ({}, None, ())
    assert why[1:] in files.page.read_text(encoding="utf-8")
    assert "pictures/responses.svg" in names(tmp_path) and "pictures/models.svg" not in names(tmp_path)


def test_a_failure_leaves_the_old_report_whole_or_no_identification_json(
    stock: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = dict.fromkeys(("identification.json", "report.html", "models/kinematic.json"), "old")
    for name, text in old.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    with monkeypatch.context() as broken:
        broken.setattr("rover_sweep.report.identification.report.in_html", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            write_report(stock.result, tmp_path, stock.provenance)
    assert {name: (tmp_path / name).read_text() for name in names(tmp_path)} == old

    def full(path: Path, content: str | bytes) -> Path:
        if path.name == "report.html":
            raise UsageError("No space left on device")
        return write_file(path, content)

    monkeypatch.setattr("rover_sweep.report.identification.report.write_file", full)
    with pytest.raises(UsageError):
        write_report(stock.result, tmp_path, stock.provenance)
    assert not (tmp_path / "identification.json").exists()
