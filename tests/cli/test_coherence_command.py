"""`rover-sweep coherence` says what spoils a recording beside the verdict, in words and in JSON."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from program_calls import RunProgram

NOMINAL = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "nominal"


@pytest.fixture
def half(tmp_path: Path) -> str:
    """The first 55 % of a recording."""
    data = (NOMINAL / "run1.BIN").read_bytes()
    path = tmp_path / "run1.BIN"
    path.write_bytes(data[: int(len(data) * 0.55)])
    return str(path)


def test_half_a_run_is_warned_of(run_program: RunProgram, half: str) -> None:
    found = run_program("coherence", half)
    assert found.code == 0
    assert "warning: The recording ends before the end of the run: it ends at 86." in found.out
    assert "applet did not announce the end of the run" in found.out


def test_the_notes_are_in_the_json(run_program: RunProgram, half: str) -> None:
    (verdict,) = json.loads(run_program("coherence", "--json", half).out)
    assert verdict["run"] == "run1"
    assert {"warning", "info"} == {note["level"] for note in verdict["notes"]}
    assert any("ends before the end of the run" in note["text"] for note in verdict["notes"])
    (whole,) = json.loads(run_program("coherence", "--json", str(NOMINAL / "run1.BIN")).out)
    assert whole["notes"] == []


def test_a_whole_run_has_no_warning(run_program: RunProgram) -> None:
    found = run_program("coherence", str(NOMINAL / "run1.BIN"))
    assert "run1: keep" in found.out and "warning" not in found.out


def test_the_end_of_a_sweep_alone_is_judged(run_program: RunProgram, tmp_path: Path) -> None:
    from rover_sweep.logs.read import read_runs

    (run,) = read_runs(str(NOMINAL / "run1.BIN"))
    t, columns = run.uniform(100)
    late = t > t[0] + 40
    names = ("pwm", "r", "ay", "p", "vy", "speed")
    lines = [
        ",".join(f"{x:.6g}" for x in row)
        for row in zip(t[late], *(columns[n][late] for n in names), strict=True)
    ]
    path = tmp_path / "late.csv"
    path.write_text("\n".join([",".join(("t", *names)), *lines]))
    found = run_program("coherence", str(path))
    assert found.code == 0 and "The recording begins after the start of the run" in found.out


def test_runs_of_equal_names_are_told_apart(run_program: RunProgram, half: str) -> None:
    found = run_program("coherence", half, str(NOMINAL / "run1.BIN"))
    assert "nominal/run1: keep" in found.out and f"{Path(half).parent.name}/run1: " in found.out


def test_the_keys_of_the_json_stay(run_program: RunProgram) -> None:
    """Other programs read them: a field that is renamed keeps its key."""
    (verdict,) = json.loads(run_program("coherence", "--json", str(NOMINAL / "run1.BIN")).out)
    bands = verdict["next"]["bands"]
    assert set(verdict["next"]) == {"bands", "amplitude", "w_max", "sentence"}
    assert set(bands[0]) == {
        "low",
        "high",
        "response",
        "coherence",
        "noise_to_signal",
        "wanted",
        "amplitude",
        "reached",
        "cap",
        "drowned",
    }
