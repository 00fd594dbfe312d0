"""One SWP_GO is one run, on the official firmware: overrides of a ground station that writes it, or not.

The rule itself, with a mutant for each part: tests/firmware_params/test_go_number.py.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from firmware_faults import Rig, booted

from rover_sweep.manoeuvre.sweep import Doublet, parameters_of
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.parameters import read_parameter, write_parameter
from rover_sweep.vehicle.run.controls import HIGH, LOW, pump

pytestmark = pytest.mark.ardurover

SHORT = Doublet(amplitude=100, pulse=0.5, pause=1.0, count=4, straight=0.5)
LIMITS = {"gcs": 1.0, "v_min": 0.5, "v_max": 5.0, "still": 0.0}
STRAIGHT, ENDED, DRIVEN = 3, (0, 10), range(2, 9)  # SWP_ST
TRIM, THROTTLE, STICK_SWITCH = 1500, 1710, 6
REFUSED = r"SWP: refused: after run \d+, needs a new SWP_GO"
HOLE = 3.6  # s


@dataclass
class Ground:
    """Overrides throttle and switch ten times a second; drives while the applet is in a run."""

    rig: Rig
    link: Link
    switch: int = LOW

    def override(self) -> None:
        throttle = THROTTLE if self.rig.observer.state in DRIVEN and self.switch == HIGH else TRIM
        others = {f"chan{n}_raw": 0xFFFF for n in (1, 2, 4, 5, 7, 8)}
        self.link.to_vehicle("RC_CHANNELS_OVERRIDE", **others, chan3_raw=throttle, chan6_raw=self.switch)

    def until(self, reached: Callable[[], bool], seconds: float = 20.0) -> bool:
        deadline = self.link.line.monotonic() + seconds
        while not (so := reached()) and self.link.line.monotonic() < deadline:
            self.link.receive(0.05)
        return so

    def write_go(self) -> None:
        write_parameter(self.link, "SWP_GO", read_parameter(self.link, "SWP_GO") % 65535 + 1)

    def throw(self) -> str:
        """The switch low and then high: 'run' where one begins, else what the applet says."""
        seen = self.rig.observer.seen
        self.switch = LOW
        pump(self.link, 1.0)
        begun, refused = len(seen.begun), len(seen.said("SWP: refused"))
        self.switch = HIGH
        self.until(lambda: len(seen.begun) > begun or len(seen.said("SWP: refused")) > refused, 3.0)
        if len(seen.begun) > begun:
            return "run"
        return seen.said("SWP: refused")[-1] if len(seen.said("SWP: refused")) > refused else "nothing"

    def drive_to_its_end(self) -> str:
        """What the applet says last of the run."""
        observer = self.rig.observer
        assert self.until(lambda: observer.state in DRIVEN)
        assert self.until(lambda: observer.state in ENDED, 40.0)
        pump(self.link, 0.5)
        return observer.seen.said("SWP: run")[-1]

    def lose_it_while_it_sweeps(self) -> str:
        observer = self.rig.observer
        assert self.until(lambda: observer.state == STRAIGHT)
        self.rig.relay.set("hole")
        self.until(lambda: False, HOLE)
        self.rig.relay.set("open")
        pump(self.link, 1.0)
        return observer.seen.said("SWP: run")[-1]


@pytest.fixture
def ground(ardurover: Path, tmp_path: Path) -> Iterator[Ground]:
    """Armed; no SWP_GO was written since the applet began, and the pilot holds nothing."""
    with (
        booted(ardurover, tmp_path / "vehicle") as rig,
        Link.open(rig.relay.url, tmp_path / "ground.tlog") as link,
        link.unwatched(),
    ):
        for name, value in parameters_of(SHORT, **LIMITS).items():
            write_parameter(link, name, value)
        ground = Ground(rig, link)
        link.every(0.1, ground.override)
        pump(link, 1.0)
        link.require("go into MANUAL", "MAV_CMD_DO_SET_MODE", 1.0, 0.0)
        link.require("arm", "MAV_CMD_COMPONENT_ARM_DISARM", 1.0)
        yield ground


def test_each_run_needs_a_number_once_one_was_written_or_the_ground_was_lost(ground: Ground) -> None:
    assert ground.throw() == "run"  # nobody ever wrote one: the pilot's own switch would do
    assert re.search("stopped: (GCS lost|switch low)", ground.lose_it_while_it_sweeps())
    assert re.fullmatch(REFUSED, ground.throw())

    ground.write_go()
    assert ground.throw() == "run"
    assert ground.drive_to_its_end().endswith("done")
    assert re.fullmatch(REFUSED, ground.throw())

    ground.write_go()
    assert ground.throw() == "run"
    assert re.search("stopped: (GCS lost|switch low)", ground.lose_it_while_it_sweeps())
    assert re.fullmatch(REFUSED, ground.throw())

    _pilot_throws_while_nobody_else_can(ground)
    assert ground.throw() == "run"


def _pilot_throws_while_nobody_else_can(ground: Ground) -> None:
    """High and low on his own radio, 5 s after the ground station was last heard (RC_OVERRIDE_TIME is 3)."""
    radio, observer = ground.rig.radio, ground.rig.observer
    ground.switch = LOW
    ground.rig.relay.set("hole")
    observer.wait(5.0)
    for position in (LOW, HIGH, LOW):
        radio.hold(STICK_SWITCH, position)
        observer.wait(1.0)
    begun = len(observer.seen.begun)
    ground.rig.relay.set("open")
    pump(ground.link, 2.0)
    assert len(observer.seen.begun) == begun
