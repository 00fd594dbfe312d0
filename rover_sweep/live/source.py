"""The interface between a screen and a vehicle or recording: requests go in, updates come out.

A `Source` works in a thread of its own and never waits for the screen; the screen never waits for it.
There are two: a vehicle on a link (`live.vehicle`) and a recording that is played (`live.played`).
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import nan
from pathlib import Path
from typing import Literal, Protocol

from firmware_params.applet_parameters import PREFIX, STATES
from rover_sweep.data.geometry import MILLI_G
from rover_sweep.data.results import Advice
from rover_sweep.manoeuvre.sweep import Manoeuvre, configured_manoeuvre
from rover_sweep.session.content import SessionRun
from rover_sweep.vehicle.events import Event
from rover_sweep.vehicle.identity import has_position
from rover_sweep.vehicle.link.connection import Heard
from rover_sweep.vehicle.link.mavlink import SAFETY_ARMED, Message, kind
from rover_sweep.vehicle.preflight.rates import switch_of
from rover_sweep.vehicle.preflight.read_rover import Check
from rover_sweep.vehicle.run.controls import RunSettings
from rover_sweep.vehicle.run.one_run import STEERING_FUNCTION

# The state of a rover at an instant, and the verdict on a run, as values for a screen.


@dataclass(frozen=True)
class Snapshot:
    """The present state of the rover, about ten times a second. ISO axes: positive to the left. NaN: unknown.

    t: s, the vehicle's clock. armed, mode (custom_mode). pwm: steering output [us]; r, p [rad/s]; ay
    [m/s^2]; phi [rad]; speed [m/s]. state, state_name: of the applet; frequency: of the sweep [rad/s];
    progress: of the manoeuvre, 0..1. switch: PWM of the applet's channel [us]. battery: volts, and
    remaining 0..1. satellites, fix: GPS_FIX_TYPE. ekf: uses GPS. received: messages a second;
    recorded: bytes of the .tlog on disk. link: its fault as a sentence, '' if it is good.
    """

    t: float
    armed: bool = False
    mode: int = -1
    pwm: float = nan
    r: float = nan
    p: float = nan
    ay: float = nan
    phi: float = nan
    speed: float = nan
    state: int = 0
    state_name: str = ""
    frequency: float = nan
    progress: float = nan
    switch: float = nan
    volts: float = nan
    remaining: float = nan
    satellites: int = 0
    fix: int = 0
    ekf: bool = False
    received: float = nan
    recorded: int = 0
    link: str = ""


@dataclass(frozen=True)
class CoherenceBand:
    """Coherence of one response in a band [rad/s]: its median, and a verdict of one or two words."""

    response: str
    low: float
    high: float
    coherence: float
    words: str


@dataclass(frozen=True)
class ResponseCurve:
    """The response of one quantity to the steering, to draw it.

    Equally long: w [rad/s], gain [dB of the quantity's SI unit over the steering's], phase [deg], coherence.
    steering: "rad" of the road wheels (left is positive), as in the reports; "us" of the servo output (in
    ArduPilot a larger one turns right) where the vehicle file has no rad_per_us.
    """

    response: str
    w: tuple[float, ...]
    gain: tuple[float, ...]
    phase: tuple[float, ...]
    coherence: tuple[float, ...]
    steering: Literal["rad", "us"] = "us"


@dataclass(frozen=True)
class Verdict:
    """The verdict on a run. sentence: what to do and why, in plain words; amplitude: proposed for the
    next one [us], None if the present one is enough. per_band: amplitudes proposed band by band,
    (low, high [rad/s], us). source: the recording that was judged. curves: what was measured, to draw it.
    throttle: (of the run, proposed) [us], None if it was not too high."""

    run: str
    advice: Advice
    sentence: str
    bands: tuple[CoherenceBand, ...] = ()
    amplitude: float | None = None
    per_band: tuple[tuple[float, float, float], ...] = ()
    source: Path | None = None
    remarks: tuple[str, ...] = ()
    curves: tuple[ResponseCurve, ...] = ()
    throttle: tuple[int, int] | None = None


# ---- requests of a screen -----------------------------------------------------------------------


@dataclass(frozen=True)
class Connect:
    """Open the link, find the rover. system: its MAVLink id, None: the only one that is heard."""

    url: str
    system: int | None = None


@dataclass(frozen=True)
class Preflight:
    """Run all checks before a run; changes nothing."""


@dataclass(frozen=True)
class Fix:
    """Carry out the remedy of the check `name`; reboots only if `reboot` is true."""

    name: str
    reboot: bool = False


@dataclass(frozen=True)
class DriveRequest:
    """Drive one run; nothing moves that the settings do not allow."""

    planned: SessionRun
    settings: RunSettings = field(default_factory=RunSettings)


@dataclass(frozen=True)
class FetchLogs:
    """The vehicle's logs that are new since the session began."""


@dataclass(frozen=True)
class Play:
    """A recording: rate 0 pauses, 1 is real time; at: jump to this many seconds from its start."""

    rate: float | None = None
    at: float | None = None


Request = Connect | Preflight | Fix | DriveRequest | FetchLogs | Play

# ---- updates of a source, in addition to the events of a session ----------------------------------


@dataclass(frozen=True)
class Began:
    """A request is being carried out."""

    request: Request


@dataclass(frozen=True)
class Ended:
    """A request is done; failure: a sentence, '' if it succeeded."""

    request: Request
    failure: str = ""


@dataclass(frozen=True)
class Several:
    """More than one vehicle is heard on `url`; give the system id of one to connect."""

    url: str
    heard: tuple[Heard, ...]


@dataclass(frozen=True)
class Checked:
    """The checks of a preflight, in the order in which to correct them."""

    checks: tuple[Check, ...]


@dataclass(frozen=True)
class Judged:
    """The verdict on a run, within a second of its end."""

    verdict: Verdict


@dataclass(frozen=True)
class Lost:
    """The link is lost; reason: a sentence. The source tries to reconnect until it is closed."""

    reason: str


@dataclass(frozen=True)
class Played:
    """Position in a recording: `t` of `length` [s], at `rate` times real time."""

    t: float
    length: float
    rate: float


Update = Event | Snapshot | Began | Ended | Several | Checked | Judged | Lost | Played


class Source(Protocol):
    """A vehicle, or a recording."""

    def start(self, tell: Callable[[Update], None]) -> None:
        """Begin to work; `tell` is called in the source's own thread and must return at once."""
        ...

    def ask(self, request: Request) -> None:
        """Queue a request; returns at once."""
        ...

    def abort(self) -> None:
        """At once, before all queued requests: end the present run and release the rover."""
        ...

    def close(self) -> str:
        """End the present run as `abort` does, close the link, end the thread.

        Returns a sentence on what of the rover is not known to be released, '' if there is nothing.
        """
        ...


# Turns a vehicle's MAVLink messages into the state that a screen shows.
#
# Used for a vehicle on a link and for a telemetry log that is played: each message is passed with the time
# of the vehicle's clock. Units and fields: https://mavlink.io/en/messages/common.html.


STALE = 3.0  # s after which a fast signal that no longer comes counts as unknown
STALE_SLOW = 10.0  # s, for the battery, the satellites and the EKF's state
RATE_OVER = 1.0  # s of the vehicle's clock over which messages are counted
_MOST_TIMES = 20_000  # messages in RATE_OVER, so that a clock that stopped cannot fill the memory
_MOST_PARAMETERS = 5000  # names; ArduRover 4.6 has 1,300
_NO_VOLTAGE, _NO_SATELLITES = 65535, 255  # "not known" in SYS_STATUS and GPS_RAW_INT
_OUTPUT, _RADIO = re.compile(r"^SERVO(\d+)_FUNCTION$"), re.compile(r"^RC(\d+)_OPTION$")
_STRAIGHT, _STEERED, _DONE, _STOPPED = 3, range(3, 9), 9, 10  # states of the applet


class Telemetry:
    """The state of one vehicle. Pass only that vehicle's messages, in the order they came.

    steering: servo output that steers (1-based); switch: RC channel of the applet's switch; PARAM_VALUE
    messages update both. parameters: all that were received. manoeuvre: for the progress; if not set, the one
    in the SWP_ parameters received.
    """

    def __init__(self, steering: int = 1, switch: int = 6) -> None:
        self.steering, self.switch = steering, switch
        self.parameters: dict[str, float] = {}
        self.manoeuvre: Manoeuvre | None = None
        self.t = 0.0
        self.state, self.number = 0, 0
        self._straight_from, self._progress = math.nan, math.nan
        self._armed, self._mode = False, -1
        self._values: dict[str, tuple[float, float]] = {}  # name -> (value, when it came [s])
        self._came: deque[float] = deque(maxlen=_MOST_TIMES)
        self._readers: Mapping[str, Callable[[Message], None]] = {
            "HEARTBEAT": self._heartbeat,
            "ATTITUDE": self._attitude,
            "RAW_IMU": self._imu,
            "LOCAL_POSITION_NED": self._velocity,
            "SERVO_OUTPUT_RAW": self._outputs,
            "RC_CHANNELS": self._radio,
            "SYS_STATUS": self._battery,
            "GPS_RAW_INT": self._gps,
            "EKF_STATUS_REPORT": self._estimator,
            "NAMED_VALUE_FLOAT": self._named,
            "PARAM_VALUE": self._parameter,
        }

    def message(self, message: Message, t: float) -> None:
        """Take a message that came at `t` s of the vehicle's clock."""
        self.heard(t)
        if reader := self._readers.get(kind(message)):
            reader(message)

    def heard(self, t: float) -> None:
        """A message came whose content is not used, at `t` [s]."""
        if t < self.t - RATE_OVER:  # rebooted: all earlier values are invalid
            self._forget()
        self.t = t
        self._came.append(t)

    def snapshot(self, recorded: int = 0, link: str = "") -> Snapshot:
        """The present state. recorded: bytes of the .tlog on disk. link: fault of the link as a sentence."""
        while self._came and self._came[0] <= self.t - RATE_OVER:
            self._came.popleft()
        fast = {name: self._known(name, STALE) for name in ("pwm", "r", "p", "ay", "phi", "speed")}
        slow = {name: self._known(name, STALE_SLOW) for name in ("volts", "remaining")}
        return Snapshot(
            t=self.t,
            armed=self._armed,
            mode=self._mode,
            **fast,
            state=self.state,
            state_name=STATES.get(self.state, f"state {self.state}"),
            frequency=self._known("frequency", STALE) if self.state in _STEERED else math.nan,
            progress=self._now(),
            switch=self._known("switch", STALE),
            **slow,
            satellites=int(self._known("satellites", STALE_SLOW, 0)),
            fix=int(self._known("fix", STALE_SLOW, 0)),
            ekf=bool(self._known("ekf", STALE_SLOW, 0)),
            received=len(self._came) / RATE_OVER,
            recorded=recorded,
            link=link,
        )

    def _forget(self) -> None:
        self._values.clear()
        self._came.clear()
        self.state, self._straight_from, self._progress = 0, math.nan, math.nan

    def _known(self, name: str, stale: float, otherwise: float = math.nan) -> float:
        value, when = self._values.get(name, (otherwise, self.t))
        return value if self.t - when <= stale else otherwise

    def _keep(self, **values: float) -> None:
        """Keep values; one that is not finite counts as unknown."""
        known = {name: float(value) if math.isfinite(value) else math.nan for name, value in values.items()}
        self._values |= {name: (value, self.t) for name, value in known.items()}

    def _now(self) -> float:
        """Progress of the manoeuvre, 0..1."""
        planned = self.manoeuvre or configured_manoeuvre(self.parameters)
        if self.state in _STEERED and planned is not None:
            done = (self.t - self._straight_from) / planned.duration
            self._progress = min(max(done, 0.0), 1.0) if math.isfinite(done) else math.nan
        return self._progress

    # ---- messages ------------------------------------------------------------------------------

    def _heartbeat(self, m: Message) -> None:
        self._armed, self._mode = bool(m.base_mode & SAFETY_ARMED), int(m.custom_mode)

    def _attitude(self, m: Message) -> None:
        self._keep(r=-m.yawspeed, p=m.rollspeed, phi=m.roll, yaw=m.yaw)

    def _imu(self, m: Message) -> None:
        self._keep(ay=-m.yacc * MILLI_G)

    def _velocity(self, m: Message) -> None:
        """Forward speed; the speed over ground if the heading is unknown."""
        yaw = self._known("yaw", STALE)
        if math.isfinite(yaw):
            self._keep(speed=m.vx * math.cos(yaw) + m.vy * math.sin(yaw))
        else:
            self._keep(speed=math.hypot(m.vx, m.vy))

    def _outputs(self, m: Message) -> None:
        if m.port == (self.steering - 1) // 16:
            self._keep(pwm=getattr(m, f"servo{(self.steering - 1) % 16 + 1}_raw"))

    def _radio(self, m: Message) -> None:
        if 0 < (pwm := getattr(m, f"chan{self.switch}_raw", 0)) < _NO_VOLTAGE:
            self._keep(switch=pwm)

    def _battery(self, m: Message) -> None:
        if 0 < m.voltage_battery < _NO_VOLTAGE:  # 0 without a battery monitor
            self._keep(volts=m.voltage_battery * 1e-3)
        if m.battery_remaining >= 0:
            self._keep(remaining=m.battery_remaining / 100)

    def _gps(self, m: Message) -> None:
        self._keep(satellites=m.satellites_visible if m.satellites_visible != _NO_SATELLITES else 0)
        self._keep(fix=m.fix_type)

    def _estimator(self, m: Message) -> None:
        self._keep(ekf=has_position(m.flags))

    def _named(self, m: Message) -> None:
        if m.name == "SWP_W":
            self._keep(frequency=m.value)
        elif m.name == "SWP_RUN":
            self.number = int(m.value)
        elif m.name == "SWP_ST" and int(m.value) != self.state:
            self._enter(int(m.value))

    def _enter(self, state: int) -> None:
        if state == _STRAIGHT:
            self._straight_from = self.t
        elif state in (1, 2):
            self._straight_from, self._progress = math.nan, 0.0
        elif state == _DONE:
            self._progress = 1.0
        elif state == 0:
            self._progress = math.nan
        elif state == _STOPPED:
            self._progress = self._now()  # where it was when it stopped
        self.state = state

    def _parameter(self, m: Message) -> None:
        name, value = str(m.param_id), float(m.param_value)
        if name in self.parameters or len(self.parameters) < _MOST_PARAMETERS:
            self.parameters[name] = value
        if (match := _OUTPUT.match(name)) and round(value) == STEERING_FUNCTION:
            self.steering = int(match[1])
        elif name == f"{PREFIX}CHAN" or _RADIO.match(name):
            self.switch = switch_of(self.parameters, self.switch)
