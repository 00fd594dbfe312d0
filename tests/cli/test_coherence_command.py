"""`rover-sweep coherence` says what spoils a recording, in words and in JSON."""

from __future__ import annotations

import json
from pathlib import Path

from program_calls import RunProgram

NOMINAL = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "nominal"
KEYS = "low high response coherence noise_to_signal wanted amplitude reached cap drowned"


def test_half_a_run_is_warned_of_and_a_whole_one_is_not(run_program: RunProgram, tmp_path: Path) -> None:
    data = (NOMINAL / "run1.BIN").read_bytes()
    half = tmp_path / "run1.BIN"
    half.write_bytes(data[: int(len(data) * 0.55)])
    done = run_program("coherence", str(half))
    assert done.code == 0
    assert "warning: The recording ends before the end of the run: it ends at 86." in done.out
    assert "applet did not announce the end of the run" in done.out
    cut, whole = json.loads(run_program("coherence", "--json", str(half), str(NOMINAL / "run1.BIN")).out)
    assert (cut["run"], whole["run"]) == (f"{tmp_path.name}/run1", "nominal/run1")
    assert {"warning", "info"} == {note["level"] for note in cut["notes"]} and whole["notes"] == []


def test_the_keys_of_the_json_stay(run_program: RunProgram) -> None:
    """Other programs read them: a field that is renamed keeps its key."""
    (verdict,) = json.loads(run_program("coherence", "--json", str(NOMINAL / "run1.BIN")).out)
    assert set(verdict["next"]) == {"bands", "amplitude", "w_max", "sentence"}
    assert set(verdict["next"]["bands"][0]) == set(KEYS.split())
