"""How a bench on the official firmware ends without the laptop: by the pilot's mode switch, or by itself."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from firmware_params.param_files import shipped
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import kind
from rover_sweep.vehicle.link.streams import request_all
from rover_sweep.vehicle.parameters import read_present
from sitl.launcher import LaunchError, find_ardurover, start_ardurover
from sitl.transmitter import Transmitter

pytestmark = pytest.mark.ardurover

ROVER = Path(__file__).parents[1] / "data" / "rover.toml"
HOLD, TRIM, AWAY = 4, 1500, 80  # custom_mode of Rover; us
MODE_CHANNEL, SWITCHED = 8, 1000  # MODE_CH; us of MODE1


@dataclass
class Watched:
    """A rover, its transmitter, and a link of an onlooker's own. pwm: steering output [us] as last seen,
    at the vehicle's time `now` [s]."""

    url: str
    radio: Transmitter
    link: Link
    pwm: int = TRIM
    now: float = 0.0

    def hear(self, message: Any) -> None:
        if kind(message) == "SERVO_OUTPUT_RAW" and message.servo1_raw:  # none while it boots
            self.pwm, self.now = message.servo1_raw, message.time_usec * 1e-6

    def until(self, seen: Callable[[int], bool], seconds: float) -> float:
        """Vehicle's time [s] that it takes until the output is such; fails after `seconds`."""
        begun = self.now
        while not seen(self.pwm):
            self.link.receive(0.02)
            assert self.now < begun + seconds, f"the output is {self.pwm} us"
        return self.now - begun


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watched]:
    try:
        binary = find_ardurover()
    except LaunchError as error:
        pytest.skip(str(error))
    home = tmp_path_factory.mktemp("rover")
    (home / "modes.param").write_text(f"MODE1 {HOLD}\nMODE_CH {MODE_CHANNEL}\n", encoding="ascii")
    with start_ardurover(binary, home, defaults=[shipped("identification"), home / "modes.param"]) as rover:
        head, _, port = rover.connection.rpartition(":")
        with Link.open(rover.connection, home / "boot.tlog", timeout=60.0):
            pass  # it boots when a first client connects, and opens its second port then
        with Link.open(f"{head}:{int(port) + 2}", home / "onlooker.tlog", timeout=60.0) as link:
            assert rover.radio is not None
            found = Watched(rover.connection, Transmitter(rover.radio), link)
            request_all(link, 100.0, {"SERVO_OUTPUT_RAW": 50.0})
            with link.listening(found.hear):
                yield found
            found.radio.close()


def benched(watched: Watched, folder: Path) -> subprocess.Popen[bytes]:
    """A bench whose ramp has begun; what it says goes into a file."""
    files = {"--wheel-imu": folder / "wheel.csv", "--vehicle": ROVER, "--out": folder / "bench"}
    options = [str(word) for pair in files.items() for word in pair]
    command = [sys.executable, "-m", "rover_sweep", "bench", "--connect", watched.url, "--yes", *options]
    with (folder / "said.txt").open("wb") as said:
        program = subprocess.Popen([*command, "--steps", "150,250", "--no-write"], stderr=said)
    watched.until(lambda pwm: abs(pwm - TRIM) > AWAY, 60.0)
    return program


def test_the_mode_switch_ends_it_at_once(watched: Watched, tmp_path: Path):
    program = benched(watched, tmp_path)
    watched.radio.hold(MODE_CHANNEL, SWITCHED)
    try:
        taken = watched.until(lambda pwm: pwm == TRIM, 2.0)
        begun = watched.now
        while program.poll() is None:  # reading on: the firmware waits for an onlooker that does not
            watched.link.receive(0.1)
            assert watched.now < begun + 10.0
        said = (tmp_path / "said.txt").read_text()
        assert "ramp: the front wheels turn slowly" in said
        assert program.returncode == 4
        assert taken < 1.0
        assert "not in MANUAL" in said
        assert "rover-sweep bench --from" in said
    finally:
        program.kill()
        watched.radio.hold(MODE_CHANNEL, 1800)


def test_a_laptop_that_dies_gives_the_steering_back(watched: Watched, tmp_path: Path):
    """SIGKILL: the override lapses by itself after RC_OVERRIDE_TIME."""
    lapse = read_present(watched.link, ["RC_OVERRIDE_TIME"])["RC_OVERRIDE_TIME"]
    program = benched(watched, tmp_path)
    program.send_signal(signal.SIGKILL)
    program.wait(10.0)
    taken = watched.until(lambda pwm: pwm == TRIM, 10.0)
    assert 0.5 < taken < lapse + 0.5
