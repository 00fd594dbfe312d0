"""preflight, params and logs on the official firmware, by both libraries, from the factory to a log."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rover_sweep.cli import main
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.parameters import write_parameter, written_by_vehicle
from rover_sweep.vehicle.run.controls import pump
from sitl.launcher import Running, start_ardurover

pytestmark = pytest.mark.ardurover

AT_BOOT = {"COMPASS_DEC"}  # which the firmware finds by itself, beside what `written_by_vehicle` names
ARMED = 12.0  # s, so that the log is a large one


@pytest.fixture(scope="module")
def rover(ardurover: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """As from the factory; it boots once somebody has connected."""
    home = tmp_path_factory.mktemp("rover")
    with start_ardurover(ardurover, home) as running:
        with Link.open(running.connection, home / "boot.tlog", timeout=90.0) as link:
            pump(link, 30.0, wall_limit=60.0)
        yield running


class Program:
    """Calls the program in this process, with --json."""

    def __init__(self, rover: Running, capsys: pytest.CaptureFixture[str]) -> None:
        self._rover, self._capsys = rover, capsys

    def __call__(self, *arguments: str) -> tuple[int, Any]:
        self._capsys.readouterr()
        code = main.run((*arguments, "--json", "--connect", self._rover.connection))
        out, err = self._capsys.readouterr()
        assert out, err
        return code, json.loads(out)


@pytest.fixture
def program(
    rover: Running, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Program:
    monkeypatch.chdir(tmp_path)
    return Program(rover, capsys)


def states(found: Any) -> dict[str, str]:
    return {check["name"]: check["state"] for check in found["checks"]}


def test_parameters_are_compared_set_and_read_by_both(program: Program) -> None:
    code, found = program("preflight")
    assert code == 1 and states(found)["parameters"] == states(found)["applet"] == "bad"
    differing = [program("params", "diff", "--via", via)[1]["differences"] for via in ("mavlink", "mavsdk")]
    assert differing[0] == differing[1] and len(differing[0]) == 5
    code, found = program("params", "push", "--via", "mavsdk", "--yes")
    assert code == 0 and [p["name"] for p in found["set"]] == [d["name"] for d in differing[0]]
    Path("back.param").write_text("".join(f"{d['name']} {d['found']:g}\n" for d in differing[0]))
    code, found = program("params", "push", "back.param", "--yes")
    assert code == 0 and len(found["set"]) == 5 and found["reboot_due"] == []
    assert program("params", "push", "--yes")[0] == 0
    values = [program("params", "pull", "--via", via)[1]["parameters"] for via in ("mavlink", "mavsdk")]
    assert values[0].keys() ^ values[1].keys() == set() and len(values[0]) > 1000
    apart = {name for name in values[0] if values[0][name] != values[1][name]}
    assert all(written_by_vehicle(name) or name in AT_BOOT for name in apart)


def test_a_rover_is_made_ready_and_a_lost_radio_is_seen(program: Program, rover: Running) -> None:
    deadline = time.monotonic() + 120
    code, found = program("preflight", "--fix", "applet", "--yes")
    while code and time.monotonic() < deadline:  # the EKF takes its time
        code, found = program("preflight")
    assert code == 0, states(found)
    checks = {check["name"]: check for check in found["checks"]}
    assert checks["streams"]["state"] == "good" and "the .BIN log" in checks["source"]["seen"]
    with Link.open(rover.connection, Path("radio.tlog")) as link:
        write_parameter(link, "SIM_RC_FAIL", 1.0)
        pump(link, 3.0)
    code, found = program("preflight")
    assert code == 1 and states(found)["rc"] == "bad"
    with Link.open(rover.connection, Path("radio.tlog")) as link:
        write_parameter(link, "SIM_RC_FAIL", 0.0)
        pump(link, 3.0)
    code, found = program("preflight", "--fix", "mode", "--yes")
    assert code == 0 and states(found)["mode"] == "good"


def test_a_log_is_fetched_by_both_without_filling_the_card(program: Program, rover: Running) -> None:
    with Link.open(rover.connection, Path("armed.tlog")) as link:
        link.require("arm", "MAV_CMD_COMPONENT_ARM_DISARM", 1.0)
        pump(link, ARMED, wall_limit=60.0)
        link.require("disarm", "MAV_CMD_COMPONENT_ARM_DISARM", 0.0)
    fetched = {via: program("logs", "fetch", "--out", via, "--via", via)[1] for via in ("mavlink", "mavsdk")}
    (one,), (other,) = (found["logs"] for found in fetched.values())
    assert one["sha256"] == other["sha256"] and one["size"] > 500_000 and other["checked"]
    assert len(program("logs", "list")[1]["logs"]) <= 3  # at most one more after each download
    print(
        f"\n{one['size'] / 1e6:.2f} MB in {one['seconds']:.1f} s by MAVLink, {other['seconds']:.1f} s MAVSDK"
    )
