"""A bench on a vehicle: check, ask, move, read, release. Measured data are on disk before they are used."""

from __future__ import annotations

import datetime
import shutil
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from math import isfinite, isnan
from pathlib import Path
from typing import Protocol

from rover_sweep._version import __version__
from rover_sweep.bench.bench_folder import TELEMETRY, WHEEL_CSV, WHEEL_TLOG, AngleReading, BenchFolder
from rover_sweep.bench.programme import Movement, Target, path
from rover_sweep.bench.standstill import ASTRAY, NotAtStandstill, Standstill
from rover_sweep.bench.steering_output import NAMES, SteeringOutput, names_of, steering_output
from rover_sweep.bench.steering_override import SteeringOverride
from rover_sweep.errors import LinkError, UsageError
from rover_sweep.vehicle.identity import identify_vehicle
from rover_sweep.vehicle.link.access import Access
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.streams import Stream, request_all, stop
from rover_sweep.vehicle.parameters.read_write import read_present

INTERVAL = 0.05  # s between two positions of a ramp
RATES = {
    "SERVO_OUTPUT_RAW": 50.0,
    "ATTITUDE": 50.0,
    "RC_CHANNELS": 5.0,
    "GPS_RAW_INT": 5.0,
    "LOCAL_POSITION_NED": 5.0,
    "SYSTEM_TIME": 1.0,
}
FAST = 200.0  # Hz of SERVO_OUTPUT_RAW on a fast line: its interval limits the accuracy of a delay
WHEEL_RATES = {"ATTITUDE": 50.0}
LOOK = 1.5  # s to check the rover before anything moves
UNDER_WAY = 60.0  # us that the output may lag on a ramp, over a slow link
FOLLOWS = 1.0  # s within which the output must reach its target
Keep = Callable[[], None]


class Operator(Protocol):
    """The person beside the rover. keep: to be called repeatedly while waiting for an answer."""

    def allow(self, movement: Movement, stops: str, keep: Keep) -> bool: ...

    def angle(self, number: int, of: int, offset: float, keep: Keep) -> tuple[float, str]:
        """(angle [rad], left positive, NaN for none; the typed text)."""
        ...

    def tell(self, text: str) -> None: ...


@dataclass(frozen=True)
class WheelSource:
    """The source of the road wheel's angle: a CSV file, copied at the end, or the URL of a vehicle on it.

    same_clock: the file's times are those of the rover's clock.
    """

    file: Path | None = None
    url: str = ""
    same_clock: bool = False


@dataclass(frozen=True)
class BenchPlan:
    """The plan of a bench; unasked: move without asking, which only a simulated rover allows."""

    movements: tuple[Movement, ...]
    wheel: WheelSource | None = None
    unasked: bool = False


def drive_bench(
    url: str, folder: BenchFolder, plan: BenchPlan, operator: Operator, access: Access | None = None
) -> bool:
    """Carry out the plan, recording into the folder. Returns whether all was done. access: see `Link.open`.

    NotAtStandstill and other LinkErrors if the rover does not allow it; the steering is then released.
    """
    with ExitStack() as stack:
        link = stack.enter_context(Link.open(url, folder.path / TELEMETRY, access=access))
        vehicle = identify_vehicle(link)
        output = _look(link)
        _refuse(plan, output, url)
        for stream in _streams(link):
            if stream.hz == 0:
                operator.tell(stream.advice)
        wheel = None
        if plan.wheel and plan.wheel.url:
            any_system = replace(access or Access(), system=None)  # --system is of the rover
            wheel = stack.enter_context(
                Link.open(plan.wheel.url, folder.path / WHEEL_TLOG, access=any_system)
            )
            request_all(wheel, _loop_rate(wheel), WHEEL_RATES)
        bench = _Bench(link, output, folder, operator, wheel)
        done: list[str] = []
        try:
            with link.listening(bench.standstill):
                bench.wait(LOOK)
                bench.standstill.require()
                if isnan(bench.standstill.speed):
                    operator.tell(
                        "no GPS: check yourself that the rover is at rest; disarmed, its motor is off"
                    )
                for movement in plan.movements:
                    folder.describe(_content(url, vehicle, output, plan, done))
                    if operator.allow(movement, output.stops, bench.keep):
                        bench.carry_out(movement)
                        done.append(movement.name)
                stop(link, RATES)
        finally:
            _copy(plan.wheel, folder)
            folder.describe(_content(url, vehicle, output, plan, done))
    return len(done) == len(plan.movements)


def _look(link: Link) -> SteeringOutput:
    have = read_present(link, NAMES)
    return steering_output(have | read_present(link, names_of(have)))


def _loop_rate(link: Link) -> float:
    return read_present(link, ["SCHED_LOOP_RATE"]).get("SCHED_LOOP_RATE", 50.0)


def _streams(link: Link) -> tuple[Stream, ...]:
    slow = link.url.startswith("/dev/") and "ttyACM" not in link.url  # a telemetry radio, not USB
    return request_all(link, _loop_rate(link), RATES if slow else {**RATES, "SERVO_OUTPUT_RAW": FAST})


def _refuse(plan: BenchPlan, output: SteeringOutput, url: str) -> None:
    """UsageError, before anything moves, for steps that are too large, or for a real rover without asking."""
    largest = max(movement.largest for movement in plan.movements)
    if largest > output.reach:
        why = (
            ""
            if output.stick == 4500.0
            else (
                "; more would hold the steering stick where ArduPilot arms the rover after 2 s, unless "
                "ARMING_RUDDER is 0"
            )
        )
        raise UsageError(
            f"steps of {largest:g} us are too large: SERVO{output.servo}_MIN {output.low:g}, _TRIM "
            f"{output.trim:g}, _MAX {output.high:g} allow {output.reach:.0f} us on both sides{why}"
        )
    if plan.unasked and not (output.simulated and "127.0.0.1" in url):
        raise UsageError(
            "--yes is for a simulated rover on this machine (it has SIM_ parameters and a link to "
            "127.0.0.1); a real one moves only after somebody beside it has agreed at the terminal"
        )


class _Bench:
    """The link while it moves: time is the vehicle's."""

    def __init__(
        self, link: Link, output: SteeringOutput, folder: BenchFolder, operator: Operator, wheel: Link | None
    ) -> None:
        self.link, self.output, self.folder, self.operator = link, output, folder, operator
        self.wheel = wheel
        self.standstill = Standstill(link, output)

    def wait(self, seconds: float, until: float | None = None) -> None:
        """Wait for `seconds` of the vehicle's clock (or until it is at `until` [s])."""
        end = self.link.clock.now + seconds if until is None else until
        while self.link.clock.now < end:
            self.keep()

    def keep(self) -> None:
        """Pump both links for a short time."""
        self.link.receive(0.05)
        while self.wheel is not None and self.wheel.receive(0.0) is not None:
            pass

    def _watched(self) -> None:
        self.keep()
        self.standstill.require()

    def carry_out(self, movement: Movement) -> None:
        """One movement from the trim and back to it, released at its end."""
        self.standstill.require()
        reads, number = sum(target.read for target in movement.targets), 0
        with SteeringOverride(self.link, self.output) as steering:
            began, waited = self.link.clock.now, 0.0
            steering.to(0.0)
            for t, offset, target in path(movement, 0.0, INTERVAL):
                steering.to(offset)
                while self.link.clock.now < began + waited + t:
                    self._watched()
                if target is None and movement.kind == "steps":
                    continue
                self._follows(offset, ASTRAY if target else ASTRAY + UNDER_WAY)
                if target is None:
                    continue
                if target.read:
                    number += 1
                    asked = self.link.clock.now
                    self._read(movement, target, number, reads)
                    waited += self.link.clock.now - asked

    def _read(self, movement: Movement, target: Target, number: int, reads: int) -> None:
        angle, typed = self.operator.angle(number, reads, target.offset, self._watched)
        self._follows(target.offset)
        now, pwm = self.link.clock.now, self.standstill.pwm
        self.folder.add(AngleReading(now, movement.name, target.offset, pwm, angle, typed))

    def _follows(self, offset: float, astray: float = ASTRAY) -> None:
        """NotAtStandstill if the output does not come within `astray` us of its target."""
        wanted, end = self.output.trim + offset, self.link.clock.now + FOLLOWS
        while not abs(self.standstill.pwm - wanted) <= astray:
            if self.link.clock.now > end:
                is_at = f"{self.standstill.pwm:.0f}" if isfinite(self.standstill.pwm) else "nothing"
                raise NotAtStandstill(
                    f"the steering output does not follow: {is_at} us, asked for {wanted:.0f}; is the radio "
                    "on (without it MANUAL holds the steering at its trim), and does nothing else steer?"
                )
            self._watched()


def _copy(wheel: WheelSource | None, folder: BenchFolder) -> None:
    """Copy the wheel's file, if it exists already; `bench --from` takes one that comes later."""
    if wheel and wheel.file and wheel.file.is_file():
        try:
            shutil.copyfile(wheel.file, folder.path / WHEEL_CSV)
        except OSError as error:
            raise LinkError(f"{wheel.file} cannot be copied into the bench's folder: {error}") from error


def _content(
    url: str, vehicle: object, output: SteeringOutput, plan: BenchPlan, done: list[str]
) -> dict[str, object]:
    return {
        "rover_sweep": __version__,
        "written": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "url": url,
        "vehicle": asdict(vehicle),  # type: ignore[call-overload]
        "steering_output": asdict(output),
        "movements": [
            {
                "name": m.name,
                "kind": m.kind,
                "offsets_us": [t.offset for t in m.targets],
                "duration_s": m.duration,
            }
            for m in plan.movements
        ],
        "done": done,
        "wheel": asdict(plan.wheel) if plan.wheel else None,
    }
