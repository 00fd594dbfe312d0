"""The right to move: throttle and switch are sent only while every rule here is satisfied.

    right = RightToMove(link.line, link.clock, limits)
    with link.listening(right.message): ...
    right.holds()   # asked before each override that moves the rover
    right.lost      # why it was lost, '' while it holds

A lost right stays lost. The clocks are the vehicle's (which shows gaps in its messages), a monotonic one, one
that counts sleep, and the wall clock if the computer has none that counts sleep.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from rover_sweep.vehicle.link.connection import VehicleClock
from rover_sweep.vehicle.link.mavlink import SAFETY_ARMED, Message, kind
from rover_sweep.vehicle.link.transport import Line
from rover_sweep.vehicle.run.follow import RebootWatch

HEARD, HEARD_BEFORE = 0.9, 3.0  # s without a message: from the switch on, and before
REPORTED = 0.9  # s without the applet's state, which it reports every 0.2 s in a run
WAITING = 15.0  # s of our throttle until the speed is in the applet's band
_TURNING = 0.3  # s of doubt after a jump of the wall clock: it was set, or the computer slept
_SPARE = 6.0  # s that a phase may take longer than planned
_RC_RECEIVER = 65536  # MAV_SYS_STATUS_SENSOR_RC_RECEIVER
_RSSI_UNKNOWN = 255
_JUMP, _JUMPED = 150, 2  # us between two RC_CHANNELS; channels
_SHOWS = 5.0  # s after which RC_CHANNELS shows what was sent, over the slowest link
_DISPUTED, _TWICE = 3.0, 2  # s; messages within it
_OURS = 2  # us by which the steering channel moves with our messages (`controls`)
_MANUAL = 0
_STANDING, _WAIT, _FIRST, _LAST, _AFTER = 1, 2, 3, 8, 9  # SWP_ST


@dataclass(frozen=True)
class MovementLimits:
    """Limits of a run. drives: we drive; ours: RC channels that we override, with their value at rest [us];
    manoeuvre, still: duration of steering and of standstill [s]; v_max: highest speed [m/s]."""

    drives: bool = False
    ours: Mapping[int, int] = field(default_factory=dict)
    manoeuvre: float = math.inf
    still: float = 0.0
    v_max: float = math.inf


@dataclass(frozen=True)
class Instant:
    """One moment on every clock [s]."""

    monotonic: float
    since_boot: float
    wall: float
    vehicle: float

    def age(self, now: Instant) -> float:
        """Longest time since this moment by the computer's clocks [s]."""
        return max(now.monotonic - self.monotonic, now.since_boot - self.since_boot)

    def age_anywhere(self, now: Instant) -> float:
        """Longest time since this moment by any clock [s]."""
        return max(self.age(now), now.vehicle - self.vehicle)


@dataclass(frozen=True)
class Situation:
    """The input of the rules. Times in s, speed in m/s; `run` and `begun` 0: unknown; NaN: never heard.

    go: the number that we drew for the run; whose: SWP_GO of the run that the applet drives, 0: unknown.
    watched: the applet watches our overrides; meddled: RC_OVERRIDE_TIME as another set it [s].
    """

    limits: MovementLimits
    thrown: bool
    silence: float
    hole: float
    rebooted: bool
    state: int
    since_report: float
    in_state: float
    run: int
    begun: int
    speed: float
    since_speed: float
    armed: bool
    mode: int
    no_transmitter: str
    contested: str = ""
    go: int = 0
    whose: int = 0
    watched: bool = True
    meddled: float = math.nan

    @property
    def under_way(self) -> bool:
        return self.thrown and 0 < self.state <= _AFTER

    @property
    def driven(self) -> bool:
        return self.limits.drives and self.thrown and _WAIT <= self.state <= _LAST


def heard(s: Situation) -> str:
    limit = HEARD if s.thrown else HEARD_BEFORE
    return f"nothing was heard from the rover for {s.silence:.1f} s" if s.silence > limit else ""


def no_hole(s: Situation) -> str:
    limit = HEARD if s.thrown else HEARD_BEFORE
    return f"{s.hole:.1f} s of the rover's messages are missing" if s.hole > limit else ""


def same_boot(s: Situation) -> str:
    return "the rover rebooted" if s.rebooted else ""


def reported(s: Situation) -> str:
    if not s.under_way or s.since_report <= REPORTED:
        return ""
    if s.silence > REPORTED / 2:
        return f"nothing was heard from the rover for {s.silence:.1f} s"
    return f"the applet has not reported its state for {s.since_report:.1f} s"


def same_run(s: Situation) -> str:
    other = s.begun and s.run != s.begun
    return f"the applet started run {s.run} after run {s.begun}, without a request" if other else ""


def own_run(s: Situation) -> str:
    other = s.go and s.whose and s.whose != s.go
    return (
        f"the run belongs to another ground station (SWP_GO {s.whose}, this program drew {s.go}): two drive "
        "this rover"
        if other
        else ""
    )


def watched(s: Situation) -> str:
    return "" if s.watched else "the applet lost this program's overrides"


def override_time(s: Situation) -> str:
    other = s.under_way and not math.isnan(s.meddled)
    return f"another ground station set RC_OVERRIDE_TIME to {s.meddled:g} s in the run" if other else ""


def slow_enough(s: Situation) -> str:
    fast = s.driven and s.speed > s.limits.v_max
    return f"speed {s.speed:.2f} m/s is above SWP_V_MAX {s.limits.v_max:g}" if fast else ""


def speed_known(s: Situation) -> str:
    blind = s.driven and not s.since_speed <= REPORTED
    return (
        f"the rover's speed is unknown (no LOCAL_POSITION_NED for {s.since_speed:.1f} s: the EKF lost its "
        "position, or another ground station slowed the streams)"
        if blind
        else ""
    )


def in_time(s: Situation) -> str:
    limit = s.limits.still + _SPARE
    if s.state == _WAIT:
        limit = WAITING if s.limits.drives else math.inf
    elif _FIRST <= s.state <= _LAST:
        limit = s.limits.manoeuvre + _SPARE
    elif s.state == _AFTER:
        limit = math.inf  # the applet's own 30 s; nothing is driven
    if not s.under_way or s.in_state <= limit:
        return ""
    if s.state == _WAIT:
        return (
            f"{limit:.0f} s of throttle did not bring the speed into the band of SWP_V_MIN and SWP_V_MAX "
            f"(last {s.speed:.1f} m/s); give another throttle"
        )
    return f"the applet did not end its state {s.state} within {limit:.0f} s"


def transmitter_alive(s: Situation) -> str:
    return s.no_transmitter and f"{s.no_transmitter}: the safety pilot's transmitter may be lost"


def undisputed(s: Situation) -> str:
    return s.contested


def armed_in_manual(s: Situation) -> str:
    if not s.thrown:
        return ""
    if not s.armed:
        return "the rover was disarmed"
    return f"the rover left MANUAL (mode {s.mode})" if s.mode != _MANUAL else ""


Rule = Callable[[Situation], str]
RULES: tuple[Rule, ...] = (
    same_boot,
    heard,
    no_hole,
    reported,
    same_run,
    own_run,
    watched,
    override_time,
    slow_enough,
    speed_known,
    in_time,
    transmitter_alive,
    undisputed,
    armed_in_manual,
)
"""Each returns why the right is lost, '' if it is not."""


class RightToMove:
    """See above. Its time starts when it is made: make it after the user's consent, and listen at once.

    lost: why it was lost, '' while it holds; contested: who else moves the rover, '' for nobody.
    """

    def __init__(self, line: Line, clock: VehicleClock, limits: MovementLimits) -> None:
        self.lost = self.contested = ""
        self._line, self._clock, self._limits = line, clock, limits
        self._reboots = RebootWatch.since_now(clock)
        now = self._now()
        self._last = now
        self._reported: Instant | None = None
        self._entered = self._sped = now
        self._offset = now.wall - now.monotonic
        self._doubt: Instant | None = None
        self._hole, self._thrown, self._before = 0.0, False, 0
        self._state = self._run = self._begun = 0
        self._speed, self._armed, self._mode = math.nan, False, _MANUAL
        self._rssi, self._channels, self._no_transmitter = 0, dict[int, int](), ""
        self._go = self._whose = 0
        self._watch, self._throttle, self._meddled = True, 0, math.nan
        self._lapses: tuple[float, ...] = ()
        self._sent: list[tuple[float, Mapping[int, int]]] = []
        self._foreign: list[tuple[float, int, int]] = []

    def sends(self, override: Mapping[int, int]) -> None:
        """From now on this program overrides these RC channels {number: us}."""
        self._sent.append((self._clock.now, dict(override)))

    def watched(self, throttle: int, *lapses: float) -> None:
        """From now on the applet watches. throttle: SWP_THR [us]; lapses: values that RC_OVERRIDE_TIME may
        have [s]."""
        self._watch, self._throttle, self._lapses = True, throttle, lapses

    def thrown(self, before: int, go: int) -> None:
        """The switch goes high now. before: SWP_RUN until now, which the new run raises; go: its SWP_GO."""
        self._go, self._whose = go, 0
        self._hole, self._thrown, self._before, self._begun = 0.0, True, before, 0
        self._last, self._entered, self._state = self._now(), self._now(), 0
        self._armed = True  # until the next heartbeat
        self._channels, self._no_transmitter = {}, ""

    def holds(self) -> bool:
        """Whether the rover may be moved now. False, and `lost` '', while the wall clock is in doubt."""
        now = self._now()
        self._look_at_wall(now)
        if not self.lost:
            situation = self._situation(now)
            self.lost = next((reason for rule in RULES if (reason := rule(situation))), "")
        return not self.lost and self._doubt is None

    @property
    def silence(self) -> float:
        """Time since the vehicle was last heard [s]."""
        return self._last.age(self._now())

    @property
    def heard(self) -> bool:
        """Whether the vehicle was heard in the last HEARD_BEFORE s."""
        return self.silence < HEARD_BEFORE

    def message(self, message: Message) -> None:
        """Take a message of the vehicle."""
        now = self._now()
        if self._last.vehicle:  # its clock was known then
            self._hole = max(self._hole, now.vehicle - self._last.vehicle)
        self._last = now
        match kind(message):
            case "NAMED_VALUE_FLOAT":
                self._named(message.name, int(message.value), now)
            case "LOCAL_POSITION_NED":
                self._speed, self._sped = math.hypot(message.vx, message.vy), now
            case "HEARTBEAT":
                self._armed = bool(message.base_mode & SAFETY_ARMED)
                self._mode = int(message.custom_mode)
            case "PARAM_VALUE":
                self._parameter(str(message.param_id), float(message.param_value))
            case "SYS_STATUS":
                self._receiver(message)
            case "RC_CHANNELS":
                self._overrides_of_others(message, now.vehicle)
                self._signal(int(message.rssi))
                self._failsafe_values(message)

    def _named(self, name: str, value: int, now: Instant) -> None:
        if name == "SWP_RUN":
            self._run = value
            if self._thrown and not self._begun and value != self._before:
                self._begun = value
        elif name == "SWP_GO":
            if self._begun and self._run == self._begun:
                self._whose = value
        elif name == "SWP_THR":
            self._watch = value == self._throttle or not self._throttle
        elif name == "SWP_ST":
            self._reported = now
            if value != self._state:
                driving = _FIRST <= value <= _LAST and _FIRST <= self._state <= _LAST
                self._state, self._entered = value, self._entered if driving else now

    def _parameter(self, name: str, value: float) -> None:
        if name == "RC_OVERRIDE_TIME" and self._lapses and value not in self._lapses:
            self._meddled = value

    def _overrides_of_others(self, message: Message, now: float) -> None:
        """Two values of channels that this program never sent, while one of ours is in force.

        ArduPilot takes overrides of any station with the id in SYSID_MYGCS, and the last one counts. Ours may
        also lapse, but then all of them do.
        """
        if not self._thrown or not self._sent:
            return
        latest, since = self._sent[-1][1], now - _SHOWS
        settled = sum(t <= since for t, _ in self._sent)
        recent = [sent for _, sent in self._sent[max(settled - 1, 0) :]]
        seen = {n: int(getattr(message, f"chan{n}_raw")) for n in latest}
        self._foreign = [one for one in self._foreign if one[0] > now - _DISPUTED]
        self._foreign += [
            (now, n, us)
            for n, us in seen.items()
            if all(abs(us - sent.get(n, -_OURS)) > _OURS for sent in recent)
        ]
        in_force = [n for n, us in seen.items() if us == latest[n] != self._limits.ours.get(n)]
        if in_force and len({t for t, *_ in self._foreign}) >= _TWICE:
            _, n, us = self._foreign[-1]
            self.contested = (
                f"RC channel {n} is at {us} us, where this program sends {latest[n]}: another ground station "
                "overrides it"
            )

    def _receiver(self, message: Message) -> None:
        present = message.onboard_control_sensors_present & _RC_RECEIVER
        healthy = message.onboard_control_sensors_health & _RC_RECEIVER
        if present and not healthy:  # for good: an override of ours looks like a healthy receiver
            self._no_transmitter = "the RC receiver is not healthy (SYS_STATUS)"

    def _signal(self, rssi: int) -> None:
        if self._rssi and rssi == 0:
            self._no_transmitter = f"the radio's RSSI fell from {self._rssi} to 0"
        if rssi != _RSSI_UNKNOWN:
            self._rssi = rssi

    def _failsafe_values(self, message: Message) -> None:
        """A receiver that lost its transmitter may set all channels to failsafe values at once (4.6.3 sends
        them within 50 ms, and sets no failsafe while we override the throttle)."""
        before = self._channels
        pwm = {n: int(getattr(message, f"chan{n}_raw")) for n in range(1, 17) if n not in self._limits.ours}
        self._channels = {n: us for n, us in pwm.items() if 0 < us < 0xFFFF}
        jumped = [n for n, us in self._channels.items() if abs(us - before.get(n, us)) > _JUMP]
        if len(jumped) >= _JUMPED:
            self._no_transmitter = f"RC channels {', '.join(map(str, jumped))} jumped at once"

    def _look_at_wall(self, now: Instant) -> None:
        """After a jump of the wall clock (set, or the computer slept) the vehicle's clock shows the cause."""
        offset, self._offset = self._offset, now.wall - now.monotonic
        if self._offset - offset > HEARD:
            self._doubt = now
        elif self._doubt is not None and now.monotonic - self._doubt.monotonic > _TURNING:
            self._doubt = None

    def _situation(self, now: Instant) -> Situation:
        reported = self._reported
        return Situation(
            limits=self._limits,
            thrown=self._thrown,
            silence=self._last.age(now),
            hole=self._hole,
            rebooted=self._reboots.rebooted,
            state=self._state,
            since_report=math.inf if reported is None else reported.age_anywhere(now),
            in_state=now.vehicle - self._entered.vehicle,
            run=self._run,
            begun=self._begun,
            speed=self._speed,
            since_speed=math.inf if math.isnan(self._speed) else self._sped.age_anywhere(now),
            armed=self._armed,
            mode=self._mode,
            no_transmitter=self._no_transmitter,
            contested=self.contested,
            go=self._go,
            whose=self._whose,
            watched=self._watch,
            meddled=self._meddled,
        )

    def _now(self) -> Instant:
        line = self._line
        return Instant(line.monotonic(), line.since_boot(), line.wall(), self._clock.now)
