"""`rs.diagnose`: shown as a table, reported, saved and read back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fabricated_diagnoses import OVERLAYS, PARTLY
from fabricated_engine import PLAIN, Engine

import rover_sweep as rs

DATA = Path(__file__).parents[1] / "data"
NOMINAL = DATA / "ardurover-4.6.3" / "nominal"


@pytest.fixture(scope="module")
def runs() -> rs.Runs:
    return rs.read(NOMINAL / "run1.BIN", NOMINAL / "run4.BIN", vehicle=DATA / "rover.toml")


def test_it_shows_itself_as_a_table(engine: Engine, runs: rs.Runs) -> None:
    engine.answer = PARTLY
    found = rs.diagnose(runs, baseline="bicycle", only="steering_backlash")
    text = repr(found)
    assert text.startswith("partly explained: play in the steering")
    assert "0.00710 to 0.00940" in text and "steering_deadband" in text and "87 %" in text
    assert "unknown in p" in text and "<table>" in found._repr_html_()
    assert engine.given["settings"].baseline == "bicycle"
    assert engine.given["settings"].with_effects == ("steering_backlash",)
    assert [r.name for r in engine.given["held_out"]] == ["run4"]
    rs.diagnose(runs[:1], held_out=runs[1:])
    assert [r.name for r in engine.given["held_out"]] == ["run4"]


def test_it_is_reported_and_saved(engine: Engine, runs: rs.Runs, tmp_path: Path) -> None:
    engine.answer = replace(PLAIN, overlays=OVERLAYS[:1])
    found = rs.diagnose(runs)
    files = found.report(tmp_path / "report")
    assert "steering_backlash" in files.page.read_text() and files.document.is_file()
    again = rs.load_diagnosis(found.save(tmp_path / "found.json"))
    assert repr(again) == repr(found)
    np.testing.assert_array_equal(again.overlays[0].measured, found.overlays[0].measured)
    assert [role for role, _ in again.origin.recordings] == ["fit", "held out"]
    again.report(tmp_path / "again")
    documents = [(tmp_path / name / "diagnosis.json").read_text() for name in ("report", "again")]
    assert documents[0] == documents[1]


def test_mistakes_end_with_a_sentence(engine: Engine, runs: rs.Runs, tmp_path: Path) -> None:
    with pytest.raises(rs.UsageError, match="the vehicle is not known"):
        rs.diagnose(rs.read(NOMINAL / "run4.BIN"))
    mistakes: dict[str, Callable[[], object]] = {
        r"the first argument \(int\) must be runs": lambda: rs.diagnose(5),  # type: ignore[arg-type]
        r"held_out \(Recording\) must be a sequence of": lambda: rs.diagnose(runs[:1], held_out=runs[1]),
        r"the first argument \(int\) is not a model": lambda: rs.simulate(5, runs[0]),  # type: ignore[arg-type]
        r"the first argument \(Recording\) is not a model": lambda: rs.simulate(runs[0], 5),  # type: ignore
        "no baseline 'tricycle'": lambda: rs.diagnose(runs, baseline="tricycle"),
        "can be missing from the bicycle": lambda: rs.diagnose(runs, baseline="bicycle", only="tyre_slip"),
    }
    for words, call in mistakes.items():
        with pytest.raises(rs.UsageError, match=words):
            call()
    for limit in (float("nan"), float("inf"), -1, 0, "a", True):
        with pytest.raises(rs.UsageError, match="the time limit is .* leave it out for no limit"):
            rs.diagnose(runs, time_limit=limit)  # type: ignore[arg-type]
    assert rs.diagnose(runs, baseline="bicycle", only="roll_dof") and engine.given
    with pytest.raises(rs.UsageError, match="is not a saved result"):
        (tmp_path / "x.json").write_text("{}")
        rs.load_diagnosis(tmp_path / "x.json")
