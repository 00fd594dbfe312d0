"""CSV files with a column map."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recordings import NOMINAL, REPOSITORY

from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.logs.read import read_logs, read_runs
from rover_sweep.logs.readers.column_map import parse_column_map

FORMATS = REPOSITORY / "docs/formats.md"
TRUTH = {
    "time": "t",
    "pwm": "pwm",
    "r": "r",
    "vy": "Vy",
    "speed": "Vx",
    "phi": "phi",
    "p": "p",
    "sampling": "step",
}


def test_a_csv_gives_the_runs_of_the_log_it_belongs_to() -> None:
    runs = read_runs(str(NOMINAL / "truth.csv"), column_map=TRUTH)
    assert [r.kind for r in runs] == ["sweep", "sweep", "sweep", "doublet"]
    for n, run in enumerate(runs, 1):
        (logged,) = read_runs(str(NOMINAL / f"run{n}.BIN"))
        assert run.span == pytest.approx(logged.span, abs=4)
        assert run.mean_speed == pytest.approx(logged.mean_speed, abs=0.1)
        assert run["pwm"].hold


def table(tmp_path: Path, text: str) -> str:
    path = tmp_path / "drive.csv"
    path.write_text(text)
    return str(path)


def rows(**columns: object) -> str:
    """A CSV of 40 s at 50 Hz: t, steer (sine), rate (deg/s), v, and further columns."""
    t = np.arange(0, 40, 0.02)
    cells = {"t": t, "steer": np.sin(2 * t), "rate": 10 * np.sin(2 * t), "v": np.full(t.size, 2.0), **columns}
    lines = [",".join(str(c[k]) for c in cells.values()) for k in range(t.size)]
    return "\n".join([",".join(cells), *lines])


BASIC: dict[str, Any] = {
    "time": "t",
    "delta": {"column": "steer", "scale": 0.3},
    "r": {"column": "rate", "unit": "deg/s"},
    "speed": "v",
}


def test_units_scales_and_axes(tmp_path: Path) -> None:
    source = table(tmp_path, rows())
    (iso,) = read_runs(source, column_map=BASIC)
    (frd,) = read_runs(source, column_map={**BASIC, "axes": "frd", "filters": {"gyro_hz": 20}})
    assert np.max(iso["r"].x) == pytest.approx(np.radians(10), rel=1e-3)
    assert np.max(iso["delta"].x) == pytest.approx(0.3, rel=1e-3)
    np.testing.assert_allclose(frd["r"].x, -iso["r"].x)
    np.testing.assert_allclose(frd["delta"].x, -iso["delta"].x)
    np.testing.assert_allclose(frd["speed"].x, iso["speed"].x)
    assert frd.filters["r"].cutoff_hz == 20 and not iso.filters


def test_the_map_may_be_a_file_and_speed_a_number(tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    path.write_text(
        'time = "t"\nspeed = 2.4\nr = {column = "rate", unit = "deg/s"}\n'
        'delta = {column = "steer", scale = 0.3}\n'
    )
    (run,) = read_runs(table(tmp_path, rows()), column_map=str(path))
    assert run.mean_speed == pytest.approx(2.4)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UsageError, match="the column map is not a text file .* at byte 0"):
        read_runs(table(tmp_path, rows()), column_map=str(path))
    with pytest.raises(UsageError, match="speed, pwm or delta is missing"):
        read_runs(table(tmp_path, rows()), column_map={"time": "t", "r": "rate"})


def test_the_column_map_in_the_documentation_is_one() -> None:
    blocks = (part.split("```")[0] for part in FORMATS.read_text().split("```toml\n")[1:])
    text = next(block for block in blocks if "columns.toml" in block)
    found = parse_column_map(tomllib.loads(text), ["t", "steer", "yaw_rate"])
    assert found.columns["pwm"].names == ("steer",) and found.frd and found.constants == {"speed": 2.4}


def test_columns_with_other_names_are_found_and_told(tmp_path: Path) -> None:
    (log,) = read_logs(table(tmp_path, rows()))
    assert np.max(log.signals["r"].x) == pytest.approx(np.radians(10), rel=1e-3)
    assert np.max(log.steering[0].x) == pytest.approx(1.0, rel=1e-3) and log.signals["speed"].x[0] == 2
    assert any('found by their names and values: time = "t"' in note.text for note in log.notes)
    with pytest.raises(UsageError, match="no column was found for speed; write.*rover-sweep columns"):
        read_logs(table(tmp_path, rows().replace("t,steer,rate,v", "t,lamp,rate,door")))


def test_degrees_without_their_unit_are_refused_with_the_line_that_mends_it(tmp_path: Path) -> None:
    path = table(tmp_path, rows(turned=20 * np.sin(2 * np.arange(0, 40, 0.02))))
    with pytest.raises(DataRefused, match=r'in the column map: delta = {column = "turned", unit = "deg"}'):
        read_runs(path, column_map={**BASIC, "delta": "turned"})


def test_nan_is_left_out_and_told(tmp_path: Path) -> None:
    holes = np.tile([0.25, 0.5], 1000)
    holes[500:520] = np.nan
    (run,) = read_runs(table(tmp_path, rows(side=holes)), column_map={**BASIC, "ay": "side"})
    assert np.all(np.isfinite(run["ay"].x)) and run["ay"].x.size == 1980
    assert any("ay (column side): 20 of 2000 rows are no finite number" in n.text for n in run.notes)
    assert any("gap" in n.text for n in run.notes)


def test_an_empty_column_and_an_odd_clock_are_named(tmp_path: Path) -> None:
    nothing, t = np.full(2000, np.nan), np.arange(0, 40, 0.02)
    for change, columns, words in (
        ({"rate": nothing}, {}, r"column rate \(r\) has no row with a finite number"),
        ({"none": nothing}, {"delta": "none"}, r"column none \(delta\) has no row"),
        ({"t": np.zeros(2000)}, {}, r"column t \(the time\) has the same value in all rows"),
        (
            {"twice": np.where(t < 20, t, t - 20)},
            {"time": "twice"},
            "times of column twice are out of order.*as trial",
        ),
    ):
        with pytest.raises(DataRefused, match=words):
            read_runs(table(tmp_path, rows(**change)), column_map={**BASIC, **columns})
    (run,) = read_runs(table(tmp_path, rows(side=nothing)), column_map={**BASIC, "ay": "side"})
    assert "ay" not in run.channels
    assert any("ay (column side) is empty and was left out" in n.text for n in run.notes)


def test_trials_are_recordings_of_their_own(tmp_path: Path) -> None:
    trial = np.where(np.arange(2000) < 1000, "first", "second")
    logs = read_logs(table(tmp_path, rows(trial=trial)), column_map={**BASIC, "trial": "trial"})
    assert [log.name for log in logs] == ["drive first", "drive second"]
    assert logs[0].signals["r"].t[-1] < logs[1].signals["r"].t[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"yaw": "rate"}, "yaw is not known; the keys are"),
        ({"r": "gyro"}, "r = 'gyro', but the columns are t, steer, rate, v"),
        ({"r": {"column": "rate", "unit": "rpm"}}, "the unit 'rpm' of r is not known"),
        ({"r": {"col": "rate"}}, "it must be"),
        ({"axes": "ned"}, 'it must be "iso" or "frd"'),
        ({"trial": "lap"}, "trial = 'lap'"),
        ({"filters": {"gyro": 4}}, "filters = "),
        ({"filters": {"gyro_hz": "a"}}, "gyro_hz = 'a', it must be a finite number"),
        ({"filters": {"gyro_hz": -4}}, "gyro_hz = -4 Hz; a cut-off must be positive"),
        ({"r": True}, "r = True, it must be a finite number"),
        ({"r": 0.3}, "r = 0.3, it must be a column"),
        ({"speed": float("inf")}, "speed = inf, it must be a finite number"),
        ({"r": {"column": "rate", "scale": "x"}}, "scale of r = 'x', it must be a finite number"),
        ({"r": {"column": "rate", "scale": 0}}, "scale of r = 0, it must be another number"),
        ({"r": {"column": "rate", "offset": "x"}}, "offset of r = 'x'"),
        ({"r": {"column": "rate", "unit": "ft/s"}}, "the unit 'ft/s' of r is not known; use rad/s, deg/s"),
        ({"time": {"column": "t", "unit": "deg"}}, "the unit 'deg' of time is not known; use s, ms, us"),
        ({"time": {"column": "t", "scale": -1}}, "scale of time = -1, it must be above 0"),
    ],
)
def test_wrong_maps_say_what_is_wrong(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        read_runs(table(tmp_path, rows()), column_map={**BASIC, **change})


def test_a_trial_may_be_one_run_as_a_whole(tmp_path: Path) -> None:
    """A step is found by what its spectrum carries; driving straight is a run only where the map says so."""
    t = np.arange(0, 40, 0.02)
    speed = np.where((t > 4) & (t < 36), 2.0, 0.0)
    source = table(tmp_path, rows(steer=np.where(t < 20, 0.5, -0.5), v=speed))
    (found,) = read_runs(source, column_map=BASIC)
    assert found.kind == "other" and found.span == pytest.approx((4.0, 36.0), abs=0.1)
    with pytest.raises(UsageError, match='"found" or "whole"'):
        read_runs(source, column_map={**BASIC, "runs": "all"})
    straight = table(tmp_path, rows(steer=np.full(t.size, 0.5), v=speed))
    with pytest.raises(DataRefused, match="no steering excitation"):
        read_runs(straight, column_map=BASIC)
    (run,) = read_runs(straight, column_map={**BASIC, "runs": "whole"})
    assert run.span == pytest.approx((4.0, 36.0), abs=0.05)


def test_marked_rows_are_left_out_and_told(tmp_path: Path) -> None:
    t = np.arange(0, 40, 0.02)
    bad = np.where((t > 10) & (t < 11), "True", "False")
    source = table(tmp_path, rows(rate=np.where(bad == "True", 1e6, 10 * np.sin(2 * t)), bad=bad))
    (run,) = read_runs(source, column_map={**BASIC, "leave_out": "bad"})
    assert np.max(np.abs(run["r"].x)) < 0.2
    assert any(n.text == "49 rows marked in column bad were left out" for n in run.notes)
    with pytest.raises(UsageError, match="leave_out = 'nowhere'"):
        read_runs(source, column_map={**BASIC, "leave_out": "nowhere"})


def test_time_may_be_in_microseconds(tmp_path: Path) -> None:
    microseconds = np.round(np.arange(0, 40, 0.02) * 1e6).astype(int)
    source = table(tmp_path, rows(us=microseconds))
    (run,) = read_runs(source, column_map={**BASIC, "time": {"column": "us", "unit": "us"}})
    (seconds,) = read_runs(source, column_map=BASIC)
    assert run.span == pytest.approx(seconds.span)
    with pytest.raises(DataRefused, match="every 2e.04 s; is the time in us"):
        read_runs(source, column_map={**BASIC, "time": "us"})


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('t,delta,r,speed\n1,"2,3,4\n' + "1,2,3,4\n" * 40_000, "is not a table of numbers .field larger"),
        ('t,delta,r,speed\n1,"2,3,4\n', "is not a table of numbers .unexpected end of data.; is a quote"),
        ("t,delta\n" + "x" * 200_000 + ",1\n", "field larger than field limit"),
        ("t,delta,r,speed,r\n1,2,3,4,5\n", "has 2 columns r; rename all but one"),
        ("t,delta,r,speed\n0,0.1,x,2\n", "column r is not numeric .'x' in row 1.$"),
        (
            't,delta,r,speed\n0,"0,1",0.2,2\n',
            "column delta is not numeric .'0,1' in row 1.; write decimal points",
        ),
    ],
)
def test_tables_that_are_none(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(DataRefused, match=reason) as caught:
        read_runs(table(tmp_path, text))
    assert "\n" not in str(caught.value)
