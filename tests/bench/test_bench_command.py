"""`rover-sweep bench` on the embedded rover: moved, recorded, measured, written; refused; stopped."""

from __future__ import annotations

import io
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import degrees
from pathlib import Path

import pytest

from rover_sweep.bench.bench_folder import BenchFolder
from rover_sweep.bench.drive import BenchPlan, Keep, Movement, drive_bench, programme
from rover_sweep.bench.evaluate import NotAtStandstill
from rover_sweep.cli.main import run
from rover_sweep.data.vehicle_file import load
from rover_sweep.errors import UsageError
from rover_sweep.logs.readers.tlog import open_tlog
from rover_sweep.vehicle.link.connection import Access
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.parameters import read_present, write_parameter
from sitl.plant.effects.steering_effects import Linkage

OnBlocks = Callable[..., str]


class Beside:
    """Somebody beside the rover who reads angles off a linkage with known play, and may do something else."""

    def __init__(self, at: int = 0, does: object = None) -> None:
        self.linkage = Linkage({"steering_backlash": {"b": 0.012}, "steering_asymmetry": {"e": 0.05}})
        self.at, self.does, self.asked, self.told = at, does, [], []

    def tell(self, text: str) -> None:
        self.told.append(text)

    def allow(self, movement: Movement, stops: str, keep: Keep) -> bool:
        self.asked.append((movement.name, stops))
        return True

    def angle(self, number: int, of: int, offset: float, keep: Keep) -> tuple[float, str]:
        if number == self.at and callable(self.does):
            self.does()
            for _ in range(400):
                keep()
        angle = self.linkage.played(self.linkage.wanted(-offset * 0.00095))
        return angle, f"{degrees(angle):.2f}"


def made(path: Path) -> BenchFolder:
    path.mkdir()
    return BenchFolder(path)


def staircase_to(*levels: float) -> BenchPlan:
    return BenchPlan(programme(levels, True, False))


def overrides(tlog: Path) -> set[int]:
    """Channels that were not the radio's, by what the rover says its inputs were."""
    rows = open_tlog(tlog, frozenset({"RC_CHANNELS"})).messages["RC_CHANNELS"].rows
    return {n for n in range(1, 9) if len(set(rows[f"chan{n}_raw"].tolist())) > 1}


def test_a_wheel_imu_finds_what_the_rover_was_made_with(
    on_blocks: OnBlocks, vehicle_toml: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    wheel, out = tmp_path / "imu.csv", tmp_path / "bench"
    url = on_blocks("--wheel", str(wheel))
    common = ["--vehicle", str(vehicle_toml), "--json"]
    imu = f"--wheel-imu {wheel} --wheel-clock vehicle --yes --steps 100,250 --out {out}"
    code = run([*f"bench --connect {url} {imu}".split(), *common])
    told = capsys.readouterr()
    assert code == 0, told.err
    assert "JUMP" in told.err and "RC_OVERRIDE_TIME" in told.err
    numbers = {number["name"]: number for number in json.loads(told.out)["numbers"]}
    truth = {"rad_per_us": 0.00095, "asymmetry": 0.05, "backlash": 0.012, "servo_lag": 0.035}
    truth |= {"servo_rate_limit": 3.0, "servo_delay": 0.015}
    for name, value in truth.items():
        number = numbers[name]
        assert name == "servo_delay" or value == pytest.approx(number["value"], rel=0.03), name
        assert abs(value - number["value"]) < 4 * number["sd"], name
    vehicle = load(vehicle_toml)
    assert vehicle.backlash is not None and vehicle.backlash.value == pytest.approx(0.012, rel=0.03)
    assert "#" in vehicle_toml.read_text()
    assert overrides(out / "bench.tlog") == {1}

    assert run(["bench", "--from", str(out), "--no-write", *common]) == 0
    again = json.loads(capsys.readouterr().out)
    assert {n["name"]: n["value"] for n in again["numbers"]} == pytest.approx(
        {name: number["value"] for name, number in numbers.items()}, rel=1e-6
    )
    assert again["written"] == {}

    described = (out / "bench.json").read_text()
    (out / "bench.json").write_text(described.replace('"servo": 1,', '"servo": 12,'))
    assert run(["bench", "--from", str(out), "--no-write", *common]) == 3
    assert "holds no PWM of SERVO12, which steers according to bench.json" in capsys.readouterr().err


def test_angles_by_hand_are_kept_one_by_one_and_evaluated_after_a_stop(
    on_blocks: OnBlocks, vehicle_toml: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    folder = made(tmp_path / "bench")
    url = on_blocks()

    def pulls_the_plug() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        drive_bench(url, folder, staircase_to(60.0, 120.0, 180.0), Beside(20, pulls_the_plug))
    assert len(folder.readings()) == 19
    assert folder.description()["done"] == []
    code = run(["bench", "--from", str(folder.path), "--vehicle", str(vehicle_toml), "--json"])
    told = capsys.readouterr()
    assert code == 0, told.err
    numbers = {number["name"]: number["value"] for number in json.loads(told.out)["numbers"]}
    assert numbers["backlash"] == pytest.approx(0.012, rel=0.05)
    assert numbers["left"] / numbers["right"] == pytest.approx(1.05 / 0.95, rel=0.01)
    assert load(vehicle_toml).servo_lag is None


def test_the_steering_is_let_go_when_the_pilot_takes_the_mode_away(on_blocks: OnBlocks, tmp_path: Path):
    folder = made(tmp_path / "bench")
    url = on_blocks()

    def takes_it() -> None:
        with Link.open(url, tmp_path / "pilot.tlog", access=Access(system=1)) as pilot:  # at once
            pilot.require("go into HOLD", "MAV_CMD_DO_SET_MODE", 1.0, 4.0)

    def hold() -> None:
        threading.Thread(target=takes_it, daemon=True).start()  # the rover waits for who does not read

    with pytest.raises(NotAtStandstill, match="not in MANUAL"):
        drive_bench(url, folder, staircase_to(100.0), Beside(3, hold))
    assert 0 < len(folder.readings()) < 9  # of the staircase
    with Link.open(url, tmp_path / "after.tlog") as link:
        inputs = link.request_message("RC_CHANNELS")
        assert inputs is not None and inputs.chan1_raw == 1500


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("RC_OVERRIDE_TIME", 10.0, "RC_OVERRIDE_TIME is 10 s"),
        ("RC_OVERRIDE_TIME", -1.0, "RC_OVERRIDE_TIME is -1 s"),
        ("RC_OVERRIDE_TIME", 0.0, "RC_OVERRIDE_TIME is 0 s"),
        ("RC_OPTIONS", 34.0, "ignore MAVLink overrides"),
        ("SERVO1_FUNCTION", 73.0, "steers by its drive"),
        ("SERVO1_FUNCTION", 0.0, "one output must steer"),
        ("SERVO1_MAX", 1600.0, "too large"),
    ],
)
def test_what_makes_it_unsafe_is_refused_before_anything_moves(
    refusing_url: str, tmp_path: Path, name: str, value: float, sentence: str
):
    operator = Beside()
    with parameters(refusing_url, tmp_path, {name: value}), pytest.raises(UsageError, match=sentence):
        drive_bench(refusing_url, made(tmp_path / "bench"), staircase_to(150.0), operator)
    assert operator.asked == []


@contextmanager
def parameters(url: str, folder: Path, values: dict[str, float]) -> Iterator[None]:
    """The rover with these parameters, which are set back at the end."""
    with Link.open(url, folder / "set.tlog") as link:
        before = read_present(link, list(values))
        for name, value in values.items():
            write_parameter(link, name, value)
    yield
    with Link.open(url, folder / "set_back.tlog") as link:
        for name, value in before.items():
            write_parameter(link, name, value)


def test_the_stick_stays_away_from_where_it_arms(refusing_url: str, tmp_path: Path):
    """3800 of 4500 unless ARMING_RUDDER is 0: ArduPilot arms at 4000 held to the right for 2 s."""
    with (
        parameters(refusing_url, tmp_path, {"SERVO1_MIN": 1100, "SERVO1_MAX": 1900}),
        pytest.raises(UsageError, match=r"allow 338 us on both sides; .* arms the rover after 2 s"),
    ):
        drive_bench(refusing_url, made(tmp_path / "bench"), staircase_to(350.0), Beside())


def test_an_armed_rover_is_refused(on_blocks: OnBlocks, tmp_path: Path):
    folder = made(tmp_path / "bench")
    url = on_blocks()
    with Link.open(url, tmp_path / "arm.tlog") as link:
        for _ in range(200):
            link.receive(0.05)
            if link.clock.now > 4.0 and link.command("MAV_CMD_COMPONENT_ARM_DISARM", 1.0) == 0:
                break
    operator = Beside()
    with pytest.raises(NotAtStandstill, match="the rover is armed"):
        drive_bench(url, folder, staircase_to(100.0), operator)
    assert operator.asked == []


def test_nobody_at_the_terminal_means_nothing_moves(
    vehicle_toml: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    arguments = ["bench", "--connect", "tcp:127.0.0.1:1", "--vehicle", str(vehicle_toml), "--hand"]
    assert run([*arguments, "--out", str(tmp_path / "bench")]) == 2
    assert "stdin is not a terminal" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("--connect", "tcp:127.0.0.1:1"),
        ("--connect", "tcp:127.0.0.1:1", "--hand", "--wheel-imu", "x.csv"),
        ("--connect", "tcp:127.0.0.1:1", "--from", "x"),
        ("--from", "x"),
        ("--connect", "tcp:127.0.0.1:1", "--hand", "--yes", "--steps", "1"),
    ],
)
def test_what_makes_no_sense_is_a_usage_error(
    vehicle_toml: Path, tmp_path: Path, arguments: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    assert run(["bench", "--vehicle", str(vehicle_toml), *arguments]) == 2
