"""A bench on a vehicle: check, ask, move, read, release. Measured data are on disk before they are used."""

from __future__ import annotations

import datetime
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from math import inf, isfinite, isnan
from pathlib import Path
from typing import Literal, Protocol

from rover_sweep._version import __version__
from rover_sweep.bench.bench_folder import TELEMETRY, WHEEL_CSV, WHEEL_TLOG, AngleReading, BenchFolder
from rover_sweep.bench.evaluate import ASTRAY, NotAtStandstill, Standstill
from rover_sweep.bench.steering_output import NAMES, SteeringOutput, names_of, steering_output
from rover_sweep.errors import LinkError, RoverSweepError, UsageError
from rover_sweep.vehicle.identity import identify_vehicle
from rover_sweep.vehicle.link.connection import Access, Periodic
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.streams import Stream, request_all, stop
from rover_sweep.vehicle.link.transport import parse_url
from rover_sweep.vehicle.parameters import read_present

# The override of the steering channel: repeated while it is active, and always released at its end.


REFRESH = 0.2  # s of the vehicle's clock
_LEAVE, _RELEASE, _RELEASE_HIGH = 0xFFFF, 0, 0xFFFE  # channels 9.. take 65534 for "back to the radio"


class SteeringOverride:
    """A context in which the steering is ours. No other channel is ever sent; nothing before `to`."""

    def __init__(self, link: Link, output: SteeringOutput) -> None:
        self.offset = 0.0
        self._link, self._output = link, output
        self._periodic: Periodic | None = None

    def __enter__(self) -> SteeringOverride:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def to(self, offset: float) -> None:
        """The steering output `offset` us from its trim, at once."""
        self.offset = offset
        if self._periodic is None:
            self._periodic = self._link.every(REFRESH, self._send)
        else:
            self._send()

    def release(self) -> None:
        """Return the channel to the radio. Never raises for a lost link: then the override lapses."""
        if self._periodic is None:
            return
        self._link.cancel(self._periodic)
        self._periodic = None
        for _ in range(3):
            try:
                self._put(_RELEASE if self._output.channel <= 8 else _RELEASE_HIGH)
            except RoverSweepError:
                return

    def _send(self) -> None:
        self._put(self._output.stick_for(self.offset))

    def _put(self, value: int) -> None:
        fields = {f"chan{n}_raw": _LEAVE for n in range(1, 17)} | {f"chan{self._output.channel}_raw": value}
        self._link.to_vehicle("RC_CHANNELS_OVERRIDE", **fields, chan17_raw=0, chan18_raw=0)


# The movements of a bench: staircases for reading by hand, slow ramps, steps. Pure.
#
# Offsets of the steering output from SERVOn_TRIM are in us. Every staircase and ramp begins at its lower
# end, so that play in the linkage is taken up before the first angle.


Kind = Literal["staircase", "ramp", "steps"]

GENTLE, SLOW = 100.0, 40.0  # us/s: between two readings, of a ramp
SETTLE, HOLD = 1.0, 0.8  # s at a level before its angle is read, after a step
LOOPS = 2
LEAST_STEP, MOST_LEVELS = 5.0, 12  # us; levels of a side


@dataclass(frozen=True)
class Target:
    """Go to `offset` [us] at `rate` [us/s], inf for a jump; hold it for `hold` s; read: an angle there."""

    offset: float
    rate: float
    hold: float
    read: bool = False


@dataclass(frozen=True)
class Movement:
    """A movement that is allowed and carried out as a whole."""

    name: str
    kind: Kind
    targets: tuple[Target, ...]

    @property
    def largest(self) -> float:
        """Largest offset, us."""
        return max(abs(target.offset) for target in self.targets)

    @property
    def duration(self) -> float:
        """s, without the time that somebody takes to read angles."""
        at, total = 0.0, 0.0
        for target in self.targets:
            total += abs(target.offset - at) / target.rate + target.hold
            at = target.offset
        return total

    @property
    def words(self) -> str:
        """A sentence on the movement."""
        size = f"to {self.largest:g} us on either side"
        if self.kind == "steps":
            return f"the front wheels JUMP {size}, {len(self.targets)} times, {self.duration:.0f} s in all"
        if self.kind == "ramp":
            return f"the front wheels turn slowly {size}, to and fro, for {self.duration:.0f} s"
        reads = sum(target.read for target in self.targets)
        return f"the front wheels turn slowly {size} and stop {reads} times for an angle to be read"


def staircase(levels: tuple[float, ...], loops: int = LOOPS) -> Movement:
    """Up and down through -levels, 0 and levels, an angle at each; `loops` times."""
    up = sorted({0.0, *levels, *(-level for level in levels)})
    path = [up[0], *(offset for _ in range(loops) for offset in (*up[1:], *up[-2::-1]))]
    stops = tuple(Target(offset, GENTLE, SETTLE, True) for offset in path)
    return Movement("staircase", "staircase", (*stops, Target(0.0, GENTLE, 0.2)))


def ramp(largest: float, loops: int = LOOPS) -> Movement:
    """Slowly from -largest to largest and back, `loops` times."""
    ends = [-largest, *(end for _ in range(loops) for end in (largest, -largest)), 0.0]
    return Movement("ramp", "ramp", tuple(Target(end, SLOW, HOLD) for end in ends))


def steps(sizes: tuple[float, ...]) -> Movement:
    """Each size to one side, back, to the other, back; at last from side to side with the largest."""
    largest = max(sizes)
    path = [offset for size in sorted(sizes) for offset in (size, 0.0, -size, 0.0)]
    path += [largest, -largest, largest, -largest, 0.0]
    return Movement("steps", "steps", tuple(Target(offset, inf, HOLD) for offset in path))


def programme(levels: tuple[float, ...], by_hand: bool, with_ramp: bool) -> tuple[Movement, ...]:
    """The movements of a bench, the gentlest first. UsageError for levels that make none."""
    levels = tuple(sorted(set(levels)))
    if not levels or levels[0] < LEAST_STEP or len(levels) > MOST_LEVELS:
        raise UsageError(
            f"--steps {', '.join(f'{x:g}' for x in levels) or 'none'}: give 1 to {MOST_LEVELS} different "
            f"sizes of {LEAST_STEP:g} us or more, as in --steps 50,100,150"
        )
    if by_hand:
        slow = (ramp(levels[-1], 1),) if with_ramp else ()
        return (staircase(levels), *slow)
    return (ramp(levels[-1]), steps(levels))


def path(movement: Movement, start: float, interval: float) -> Iterator[tuple[float, float, Target | None]]:
    """(seconds from the start, offset [us], target just reached and held or None), every `interval` s."""
    at, t = start, 0.0
    for target in movement.targets:
        while at != target.offset:
            stride = target.rate * interval
            away = target.offset - at
            at = target.offset if abs(away) <= stride else at + (stride if away > 0 else -stride)
            t += interval
            yield t, at, None
        t += target.hold
        yield t, at, target


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
    """The plan of a bench; unasked: move without confirmation, which only a simulated rover allows."""

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
        have = read_present(link, NAMES)
        output = steering_output(have | read_present(link, names_of(have)))
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


def _loop_rate(link: Link) -> float:
    return read_present(link, ["SCHED_LOOP_RATE"]).get("SCHED_LOOP_RATE", 50.0)


def _streams(link: Link) -> tuple[Stream, ...]:
    usb = "ttyACM" in link.url or "usbmodem" in link.url
    slow = parse_url(link.url).scheme == "serial" and not usb  # it may be a telemetry radio
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
        """Move from the trim and back to it, then release."""
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
