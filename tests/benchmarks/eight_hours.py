"""Eight hours of telemetry as fast as they go: memory flat, files as long as what was received.

    python -m tests.benchmarks.eight_hours --hours 8

A made-up vehicle on its own clock goes through the link, the recorder, the telemetry and the state of the
session's screens. It sends 25 messages a second, texts whose last part never comes, and names of parameters
that it never sent before.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from rover_sweep.errors import LinkError
from rover_sweep.live.source import Telemetry
from rover_sweep.tui.model.state import State, reduce
from rover_sweep.vehicle.events import Said
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import Codec
from rover_sweep.vehicle.link.transport import Transport

HOUR = 3600.0
SHOWN = 0.5  # s between two snapshots
GROWTH = 20.0  # MB from the first hour to the last that are still flat
STAMP = 8  # bytes before each frame of a .tlog


@dataclass(frozen=True)
class Hour:
    """memory: MB resident at the end; received, recorded: bytes up to there."""

    number: float
    memory: float
    received: int
    recorded: int
    frames: int


class Afternoon(Transport):
    """Line and transport in one: each `receive` is .2 s of the vehicle's time."""

    def __init__(self, seconds: float) -> None:
        self.now, self.end, self.received, self.frames = 0.0, seconds, 0, 0
        self._codec, self._count = Codec(1, 1), 0

    def open(self, url: str, timeout: float = 5.0) -> Afternoon:
        return self

    def receive(self, timeout: float) -> bytes:
        if self.now >= self.end:
            raise ConnectionResetError("closed by the vehicle")
        frames = [self._codec.pack(message) for message in self._messages()]
        self.now += 0.2
        self.received += sum(map(len, frames))
        self.frames += len(frames)
        return b"".join(frames)

    def _messages(self) -> Iterator[Any]:
        self._count += 1
        ms, us = round(1e3 * self.now), round(1e6 * self.now)
        for _ in range(2):
            yield dialect.MAVLink_attitude_message(ms, 0.0, 0.0, 0.1, 0.0, 0.0, 0.2)
        yield dialect.MAVLink_raw_imu_message(us, 0, 100, -1000, 1, 2, 3, 0, 0, 0)
        yield dialect.MAVLink_servo_output_raw_message(us % 2**32, 0, 1500, 0, 1600, 0, 0, 0, 0, 0)
        if self._count % 5 == 0:
            yield dialect.MAVLink_heartbeat_message(10, 3, 128, 0, 4, 3)
            yield dialect.MAVLink_local_position_ned_message(ms, 0.0, 0.0, 0.0, 2.4, 0.1, 0.0)
            name = f"N{self._count}".encode()
            yield dialect.MAVLink_param_value_message(name, 1.0, 9, 900, 1)
            yield dialect.MAVLink_statustext_message(6, b"x" * 50, self._count % 65535 + 1, 0)

    def monotonic(self) -> float:
        return self.now

    since_boot = wall = monotonic

    def sleep(self, seconds: float) -> None:
        self.now += seconds

    def send(self, data: bytes) -> None:
        pass

    def close(self) -> None:
        pass


def resident() -> float:
    """Memory of this program now, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def afternoon(hours: float, folder: Path, every: float = HOUR) -> list[Hour]:
    """What was seen at the end of each `every` s of the vehicle's time."""
    line, found, telemetry, state = Afternoon(hours * HOUR), list[Hour](), Telemetry(), State()
    path, shown = folder / "connect.tlog", 0.0
    with Link.open("tcp:made:1", path, line=line) as link:  # type: ignore[arg-type]
        link.hear(lambda message: telemetry.message(message, link.clock.now))
        with suppress(LinkError):
            while True:
                link.receive(0.5)
                if line.now >= shown + SHOWN:
                    shown = line.now
                    state = reduce(state, telemetry.snapshot(path.stat().st_size))
                    if link.texts:
                        state = reduce(state, Said(link.clock.now, 6, link.texts[-1].text))
                if line.now >= every * (len(found) + 1):
                    found.append(_hour(line, path, len(found) + 1))
    found.append(_hour(line, path, line.now / HOUR))
    return found


def _hour(line: Afternoon, path: Path, number: float) -> Hour:
    return Hour(number, resident(), line.received, path.stat().st_size, line.frames)


def faults(hours: Sequence[Hour]) -> list[str]:
    """What is not as it must be."""
    found, last = list[str](), hours[-1]
    if last.memory - hours[0].memory > GROWTH:
        found.append(f"memory grew by {last.memory - hours[0].memory:.0f} MB")
    if last.recorded != last.received + STAMP * last.frames:
        found.append(f"{last.recorded} bytes recorded of {last.received} in {last.frames} frames")
    return found


def main() -> int:
    """Exit code 1 where memory grew or the file is not what was received."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=8.0)
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        hours = afternoon(parser.parse_args().hours, Path(folder))
    print(f"{'hour':>6}{'memory, MB':>12}{'received, MB':>14}{'.tlog, MB':>11}{'messages':>11}")
    for h in hours:
        print(
            f"{h.number:6.2f}{h.memory:12.1f}{h.received / 1e6:14.2f}{h.recorded / 1e6:11.2f}{h.frames:11d}"
        )
    found = faults(hours)
    print("; ".join(found) or "memory flat, file as received", f"({time.monotonic() - begun:.0f} s)")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
