"""`identify LOG` of an AUTO mission on the real firmware: ArduRover drives drawn waypoints, its log is read.

    python -m tests.benchmarks.auto_on_firmware --ardurover FILE [--seed 1] [--waypoints 40] [--out DIR]

The nominal rover of `sitl` behind ArduRover's SITL program, with the firmware's own parameters but for those
that every owner sets (cruise speed and throttle, gyro calibration), drives some 40 waypoints within 20 m at
1.2 to 2.4 m/s. The log is read as `rover-sweep identify LOG` reads it, and compared with the rover. Some
minutes.
"""

from __future__ import annotations

import argparse
import tempfile
from math import cos, radians
from pathlib import Path

import numpy as np

from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.run.controls import pump
from sitl.launcher import HOME, find_ardurover, start_ardurover
from sitl.plant.variant import load_variant
from tests.ardurover.arming import arm_in_mode
from tests.benchmarks.any_driving import checked

AUTO = 10  # custom_mode of Rover
SETTINGS = {"CRUISE_SPEED": 2.0, "CRUISE_THROTTLE": 42.0, "WP_SPEED": 2.0, "SCR_ENABLE": 0}
REACH, METRES_PER_DEGREE = 20.0, 111_195.0
LONGEST_S = 1200.0


def waypoints(count: int, rng: np.random.Generator) -> list[tuple[int, float, float, float]]:
    """(MAV_CMD, its first parameters' speed [m/s], latitude, longitude [deg]) of a drawn mission."""
    latitude, longitude = (float(word) for word in HOME.split(",")[:2])
    items, at = [(16, 0.0, latitude, longitude)], np.zeros(2)
    for k in range(count):
        if k % 4 == 0:
            items.append((178, float(rng.uniform(1.2, 2.4)), 0.0, 0.0))
        step = np.zeros(2)
        while not 6.0 < np.hypot(*step) < 20.0:
            step = rng.uniform(-REACH, REACH, 2) - at
        at = at + step
        north, east = (at / METRES_PER_DEGREE).tolist()
        items.append((16, 0.0, latitude + north, longitude + east / cos(radians(latitude))))
    return items


def upload(link: Link, items: list[tuple[int, float, float, float]]) -> None:
    """By the mission protocol; AssertionError where the vehicle does not take it."""
    link.to_vehicle("MISSION_COUNT", count=len(items), mission_type=0)
    asks = ("MISSION_REQUEST", "MISSION_REQUEST_INT")
    while message := link.wait_for((*asks, "MISSION_ACK"), 5.0):
        if message.get_type() == "MISSION_ACK":
            assert message.type == 0, f"the vehicle refuses the mission ({message.type})"
            return
        command, speed, latitude, longitude = items[message.seq]
        place = {"x": round(1e7 * latitude), "y": round(1e7 * longitude), "z": 0.0}
        numbers = {"param1": 0.0, "param2": speed, "param3": 0.0, "param4": 0.0, **place}
        numbers |= {"seq": message.seq, "frame": 3, "current": 0, "autocontinue": 1, "mission_type": 0}
        link.to_vehicle("MISSION_ITEM_INT", command=command, **numbers)
    raise AssertionError("the vehicle stopped to ask for waypoints")


def drive(binary: Path, folder: Path, seed: int, count: int, speedup: float) -> Path:
    """The log of a drawn mission."""
    settings = folder / "settings.param"
    settings.write_text("".join(f"{n} {v:g}\n" for n, v in SETTINGS.items()), encoding="ascii")
    items = waypoints(count, np.random.default_rng(seed))
    with (
        start_ardurover(binary, folder / "vehicle", seed=seed, defaults=[settings], speedup=speedup) as rover,
        Link.open(rover.connection, folder / "drive.tlog") as link,
    ):
        pump(link, 10.0, 60.0)
        upload(link, items)
        arm_in_mode(link, AUTO, "AUTO", arm_first=True)
        begun = link.clock.now
        while link.clock.now - begun < LONGEST_S:
            reached = link.wait_for("MISSION_ITEM_REACHED", 60.0)
            if reached is None or reached.seq >= len(items) - 1:
                break
        print(f"the mission took {link.clock.now - begun:.0f} s", flush=True)
        pump(link, 3.0, 20.0)
        link.command("MAV_CMD_COMPONENT_ARM_DISARM", 0.0)
        pump(link, 1.0)
    return max((folder / "vehicle" / "logs").glob("*.BIN"))


def main() -> None:
    """Drives, and prints what the log says against the rover."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.auto_on_firmware", description=__doc__)
    parser.add_argument("--ardurover", help="the SITL program (else $ROVER_SWEEP_ARDUROVER or the PATH)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--waypoints", type=int, default=40)
    parser.add_argument("--speedup", type=float, default=1.0)
    parser.add_argument("--out", type=Path, help="keep everything of the drive in this folder")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = asked.out or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        log = drive(find_ardurover(asked.ardurover), folder, asked.seed, asked.waypoints, asked.speedup)
        print(checked("AUTO on the firmware", load_variant("nominal"), log))


if __name__ == "__main__":
    main()
