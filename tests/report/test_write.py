"""The report folder."""

from __future__ import annotations

import csv
import json
import os
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rover_sweep.data.results import number
from rover_sweep.errors import UsageError
from rover_sweep.files import documents
from rover_sweep.files.documents import write_file
from rover_sweep.report.identification.identification_json import identification_document
from rover_sweep.report.identification.report import identification_report, write_report
from rover_sweep.report.in_html import in_html


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
    assert [p.name for p in (reports["stock"] / "models").iterdir()] == ["kinematic.json"], (
        "not a rejected one"
    )
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


@pytest.mark.skipif(os.name == "nt", reason="Windows has no umask")
@pytest.mark.parametrize(("umask", "mode"), [(0o077, 0o600), (0o022, 0o644), (0o002, 0o664)])
def test_a_file_is_readable_by_whom_the_umask_allows(tmp_path: Path, umask: int, mode: int) -> None:
    before = os.umask(umask)
    try:
        written = [write_file(tmp_path / "a.html", "x"), write_file(tmp_path / "new" / "a.html", b"x")]
    finally:
        os.umask(before)
    assert [path.stat().st_mode & 0o777 for path in written] == [mode, mode]
    assert {path.name for path in tmp_path.rglob("*")} == {"a.html", "new"}


def test_no_other_writer_sets_a_mode() -> None:
    """Pages and logs hold positions: whoever has a umask of 077 gives them to nobody."""
    sets = re.compile(
        r"\b(f?chmod|umask|copymode|copystat|copytree|shutil\.copy2?|NamedTemporaryFile|mkstemp)\("
    )
    package = Path(documents.__file__).parents[1]
    assert not [
        f"{path.name}: {line}"
        for path in package.rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if sets.search(line)
    ]


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


# ---- report.html: one page, nothing fetched, all pictures in it.


class Elements(HTMLParser):
    """Tags with attributes, visible text, and whether every tag was closed."""

    VOID = ("meta", "img", "br", "link", "input", "hr")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self.open and "script" not in self.open:
            self.text += data


@pytest.fixture(scope="module")
def html(reports: dict[str, Path]) -> str:
    return (reports["nominal"] / "report.html").read_text(encoding="utf-8")


def test_page_is_well_formed_and_fetches_nothing(html: str) -> None:
    elements = Elements(html)
    assert elements.open == []
    assert not [tag for tag, _ in elements.tags if tag in ("link", "iframe")]
    assert not [a for tag, a in elements.tags if tag == "script" and "src" in a]
    policy = next(a["content"] for _, a in elements.tags if a.get("http-equiv"))
    assert policy and policy.startswith("default-src 'none'") and "http" not in policy
    links = [v for _, a in elements.tags for k, v in a.items() if k in ("src", "href") and v]
    assert {v[1:] for v in links if v.startswith("#")} <= {a.get("id") for _, a in elements.tags}
    assert all(v.startswith("#") for v in links)
    assert "url(" not in html and "@import" not in html


def test_rejected_numbers_are_nowhere_on_the_page(reports: dict[str, Path], stock: Any) -> None:
    text = Elements((reports["stock"] / "report.html").read_text(encoding="utf-8")).text
    rejected = stock.result.models["bicycle"].fit
    assert "not identifiable" in text and "Use the kinematic model" in text
    assert number(rejected["C"].value) not in text
    assert number(stock.result.models["kinematic"].fit["L_eff"].value) in text


def test_names_from_files_cannot_become_markup(nominal: Any) -> None:
    vehicle = replace(nominal.provenance.vehicle, name="<script>alert(1)</script>")
    text = in_html(identification_report(nominal.result, replace(nominal.provenance, vehicle=vehicle)))
    assert "<script>" not in text and "&lt;script&gt;" in text
