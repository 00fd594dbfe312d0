"""Whether a steering was commanded or measured: from every reader, through every change, into every file."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from test_foreign_files import FORMATS, drive, written

import rover_sweep as rs
from rover_sweep.cli.main import cli
from rover_sweep.data.recording import Recording, Signal, origin_remark, steered, steering_of
from rover_sweep.errors import UsageError
from rover_sweep.identification.pipeline import identified_runs
from rover_sweep.logs.log import joined_steering
from rover_sweep.logs.read import read_logs
from rover_sweep.logs.readers.column_names import origin_in
from rover_sweep.logs.readers.vehicle_clock import at_main_loops
from rover_sweep.report.identification.identification_json import identification_document

DATA = Path(__file__).parents[1] / "data"
NOMINAL = DATA / "ardurover-4.6.3" / "nominal"
NAMES = {"time": "t", "r": "r", "speed": "v"}


@pytest.mark.parametrize("source", ["run1.BIN", "run1.tlog", "run1.BIN+run1.tlog"])
def test_the_outputs_of_an_autopilot_are_commands(source: str) -> None:
    source = "+".join(str(NOMINAL / part) for part in source.split("+"))
    (log,) = read_logs(source)
    messages = {s.source.partition(".")[0] for s in log.steering}
    of = {".BIN": {"SWEP", "RCOU"}, ".tlog": {"SERVO_OUTPUT_RAW"}}
    assert messages == set().union(*(of[Path(part).suffix] for part in source.split("+")))
    assert {s.origin for s in log.steering} == {"commanded"}
    (run,) = rs.read(source, vehicle=DATA / "rover.toml")
    assert run["pwm"].origin == run["delta"].origin == "commanded"
    assert run["r"].origin == "unknown", "it has no meaning there"


@pytest.mark.parametrize("kind", FORMATS)
def test_a_map_says_it_for_every_file_of_another_system(kind: str, tmp_path: Path) -> None:
    path, names = FORMATS[kind](tmp_path)
    delta = names["delta"] if isinstance(names["delta"], dict) else {"column": names["delta"]}
    for origin in ("commanded", "measured", "unknown"):
        (log,) = read_logs(str(path), column_map=names | {"delta": delta | {"origin": origin}})
        assert log.steering[0].origin == origin
    (log,) = read_logs(str(path), column_map=names)
    assert log.steering[0].origin == "unknown"


def csv(folder: Path, **more: Any) -> str:
    d = drive()
    angle = d["delta"]
    columns = {"t": d["t"], "r": d["r"], "v": d["v"], "angle": angle, "pulse": 1500 - 1000 * angle}
    return str(written(folder / "drive.csv", columns | more))


def test_a_pulse_is_a_command_a_servo_is_measured_and_an_angle_unknown(tmp_path: Path) -> None:
    path = csv(tmp_path)
    (log,) = read_logs(path, column_map=NAMES | {"delta": "angle", "pwm": "pulse", "servo": "pulse"})
    assert [(s.unit, s.origin) for s in log.steering] == [("rad", "unknown"), ("us", "commanded")]
    assert log.signals["servo"].origin == "measured"
    pulses = {"column": "pulse", "origin": "measured"}
    (run,) = rs.read(path, columns=NAMES | {"pwm": pulses}, vehicle=DATA / "rover.toml")
    assert run["delta"].origin == "measured", "the map is right, whatever the unit"
    (run,) = rs.read(
        path, columns=NAMES | {"pwm": "pulse", "servo": "pulse"}, servo=True, vehicle=DATA / "rover.toml"
    )
    assert run["delta"].origin == "measured"


def test_a_wrong_origin_is_refused_with_the_words_that_are_right(tmp_path: Path) -> None:
    path = csv(tmp_path)
    wrong = (
        ({"delta": {"column": "angle", "origin": "encoder"}}, '\'encoder\', it must be "commanded", "meas'),
        ({"delta": {"column": "angle", "origin": ["measured"]}}, "it must be"),
        ({"delta": "angle", "r": {"column": "r", "origin": "measured"}}, "unit, scale, offset"),
    )
    for change, words in wrong:
        with pytest.raises(UsageError, match=words):
            read_logs(path, column_map=NAMES | change)


@pytest.mark.parametrize(
    ("name", "origin"),
    [
        ("steer_cmd", "commanded"),
        ("/commands/servo/position", "commanded"),
        ("/ackermann_cmd.steering_angle", "commanded"),
        ("/drive.drive.steering_angle", "commanded"),
        ("actuator_servos.control[0]", "commanded"),
        ("Lenkwinkel soll", "commanded"),
        ("steering_angle_measured", "measured"),
        ("/vehicle/steering_report.steering_wheel_angle", "measured"),
        ("steerEncoder", "measured"),
        ("Lenkwinkel ist", "measured"),
        ("steering_feedback [deg]", "measured"),
        ("steering", "unknown"),
        ("delta", "unknown"),
        ("servo", "unknown"),
        ("steer_cmd_feedback", "unknown"),
    ],
)
def test_a_name_may_say_it(name: str, origin: str) -> None:
    assert origin_in(name) == origin


@pytest.mark.parametrize(
    ("name", "origin", "words"),
    [
        ("steering_cmd", "commanded", "likely commanded, by its name"),
        ("steering_encoder", "measured", "likely measured, by its name"),
        ("steering", "unknown", "commanded or measured is not known, and gains need it"),
    ],
)
def test_columns_writes_its_guess_and_what_to_add(tmp_path: Path, name: str, origin: str, words: str) -> None:
    d = drive()
    columns = {"time": d["t"], name: d["delta"], "yaw_rate": d["r"], "speed": d["v"]}
    path, out = written(tmp_path / "drive.csv", columns), tmp_path / "columns.toml"
    shown = CliRunner().invoke(cli, ["columns", str(path), "--out", str(out)])
    assert shown.exit_code == 0, shown.output
    text = out.read_text()
    assert words in text
    (log,) = read_logs(str(path), column_map=tomllib.loads(text))
    assert log.steering[0].origin == origin
    offered = f'# delta = {{column = "{name}", origin = "commanded"}}  # or "measured"'
    assert (offered in text) == (origin == "unknown")


def test_it_survives_cuts_joins_stamps_and_units() -> None:
    t = np.arange(0.0, 10.0, 0.1)
    for origin in ("commanded", "measured", "unknown"):
        signal = Signal(t, 1500 + 100 * np.sin(t), "us", "any", True, origin)
        moved = at_main_loops(signal, np.arange(0.0, 10.0, 0.02))
        for changed in (
            signal.between(2.0, 3.0),
            moved,
            joined_steering(signal, replace(signal, t=t + 0.05)),
        ):
            assert changed.origin == origin
        run = Recording("by hand", {"pwm": signal}, (1.0, 9.0))
        assert steered(run, 1500, 0.001)["delta"].origin == origin
        assert run.without(()).manoeuvre("pwm").origin == origin


def test_a_measured_steering_is_not_sent_through_the_linkage_again(tmp_path: Path) -> None:
    rover = tmp_path / "rover.toml"
    text = (DATA / "rover.toml").read_text()
    rover.write_text(text.replace("[steering]\n", "[steering]\nbacklash = 0.02\nasymmetry = 0.1\n"))
    path, found = csv(tmp_path), {}
    for origin in ("commanded", "measured"):
        pulses = {"column": "pulse", "origin": origin}
        (run,) = rs.read(path, columns=NAMES | {"pwm": pulses}, vehicle=rover)
        found[origin] = run["delta"]
    assert np.ptp(found["measured"].x) == pytest.approx(0.95 * np.ptp(drive()["delta"]), rel=0.01)
    assert found["commanded"].x.shape != found["measured"].x.shape or not np.allclose(
        found["commanded"].x, found["measured"].x, atol=0.005
    )


def test_it_is_in_the_report_the_json_and_a_saved_result(tmp_path: Path) -> None:
    """For each origin; a file that an older version saved has none, and is unknown."""
    runs = rs.read(NOMINAL / "run1.BIN", vehicle=DATA / "rover.toml")
    for origin in ("commanded", "measured", "unknown"):
        delta = replace(runs[0]["delta"], origin=origin, source="angle")
        changed = replace(runs[0], channels={**runs[0].channels, "delta": delta})
        result = rs.identify(replace(runs, recordings=(changed,)), models=["bicycle"], bootstrap=0)
        saved = result.save(tmp_path / "result.json")
        (again,) = identified_runs(rs.load_result(saved))
        assert again["delta"].origin == origin
        (told,) = identification_document(result, result.origin)["runs"]
        assert told["channels"]["delta"]["origin"] == origin and "origin" not in told["channels"]["r"]
        page = result.report(tmp_path / origin).page.read_text()
        assert ("was measured in run1 (angle), so the model excludes the servo" in page) == (
            origin == "measured"
        )
        assert ("commanded or measured is unknown in run1 (angle)" in page) == (origin == "unknown")
        assert f"angle ({origin})" in page
    saved.write_text(json.dumps(without_origin(json.loads(saved.read_text()))))
    (old,) = identified_runs(rs.load_result(saved))
    assert old["delta"].origin == "unknown"


def without_origin(part: Any) -> Any:
    """A saved result without the origins of its signals."""
    if isinstance(part, list):
        return [without_origin(item) for item in part]
    if not isinstance(part, dict):
        return part
    signal = part.get("is") == "Signal"
    return {k: without_origin(v) for k, v in part.items()} | (
        {"of": without_origin({k: v for k, v in part["of"].items() if k != "origin"})} if signal else {}
    )


def test_a_signal_of_another_origin_is_refused() -> None:
    with pytest.raises(ValueError, match="'encoder'; it must be commanded, measured or unknown"):
        Signal(np.arange(3.0), np.arange(3.0), "rad", "mine", origin="encoder")  # type: ignore[arg-type]


def test_runs_of_both_kinds_are_named(tmp_path: Path) -> None:
    t = np.arange(0.0, 10.0, 0.1)
    one, two = (
        Recording(name, {"delta": Signal(t, np.sin(t), "rad", "angle", origin=origin)}, (1.0, 9.0))
        for name, origin in (("run1", "commanded"), ("run2", "measured"))
    )
    assert origin_remark(steering_of([one])) == "" == origin_remark({})
    words = origin_remark(steering_of([one, two]))
    assert "commanded in run1 (angle)" in words and "measured in run2 (angle)" in words


def test_an_answer_from_any_driving_says_it_too(tmp_path: Path) -> None:
    path, found = csv(tmp_path), {}
    for origin in ("commanded", "measured", "unknown"):
        angle = {"column": "angle", "origin": origin}
        found[origin] = " ".join(rs.identify_driving(path, columns=NAMES | {"delta": angle}).read)
    assert "the steering was measured in drive (angle), so the model excludes the servo" in found["measured"]
    assert "commanded or measured is unknown in drive (angle)" in found["unknown"]
    assert "steering" not in found["commanded"]
