"""How to move the steering at a standstill, and the conditions for it. Pure.

The steering is moved by RC_CHANNELS_OVERRIDE of the steering channel alone, in MANUAL, DISARMED. Facts of
Rover-4.6.3, read there and seen on the program: AP_MotorsUGV::output_regular always lets the steering move,
and holds the throttle at its trim or off while disarmed; GCS_MAVLINK::handle_rc_channels_override accepts
only the rover's own ground station (`link.ground_station`), and 65535 leaves a channel to the radio; an
override lapses RC_OVERRIDE_TIME after the last one (0: none works, below 0: it never lapses).

Rover::rudder_arm_disarm_check ARMS a rover whose steering stick is further right than 4000 of 4500 for 2 s
with the throttle at rest, unless ARMING_RUDDER is 0, and an override counts as the stick (seen: 4403 of 4500
armed it, 3615 did not): so the stick stays within `STICK_LIMIT`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rover_sweep.errors import UsageError
from rover_sweep.vehicle.link.greeting import NEW_NAMES, OLD_NAME, why_overrides_ignored

STEERING, SKID = 26, (73, 74)  # SERVOn_FUNCTION GroundSteering, ThrottleLeft and ThrottleRight
FULL, STICK_LIMIT = 4500.0, 3800.0  # RC_Channel angle of a full stick; where arming by the stick is far
LONGEST_LAPSE = 3.0  # s
IGNORE_OVERRIDES = 2  # RC_OPTIONS
OVERRIDE_SWITCH = 46  # RCn_OPTION "RC override enable"
CHANNELS = range(1, 17)

NAMES: tuple[str, ...] = (
    "RC_OVERRIDE_TIME",
    "RC_OPTIONS",
    OLD_NAME,
    "RCMAP_ROLL",
    "RCMAP_THROTTLE",
    "ARMING_RUDDER",
    "MANUAL_STR_EXPO",
    "SIM_RC_FAIL",
    *(f"SERVO{n}_FUNCTION" for n in CHANNELS),
    *(f"RC{n}_OPTION" for n in CHANNELS),
)


@dataclass(frozen=True)
class SteeringOutput:
    """The steering's servo output and the RC channel that leads to it; all PWM in us.

    servo, channel, throttle_channel: from 1. expo: MANUAL_STR_EXPO. stick: largest stick of 4500. lapse:
    RC_OVERRIDE_TIME [s]. throttle_trim, throttle_zone: where the throttle stick rests. switch: RC channel
    whose switch turns overrides off, 0 for none. simulated: it has a simulator's parameters.
    """

    servo: int
    trim: float
    low: float
    high: float
    reversed: bool
    channel: int
    rc_trim: float
    rc_low: float
    rc_high: float
    rc_zone: float
    rc_reversed: bool
    expo: float
    stick: float
    lapse: float
    throttle_channel: int
    throttle_trim: float
    throttle_zone: float
    switch: int = 0
    simulated: bool = False

    @property
    def reach(self) -> float:
        """Largest offset [us] that may be asked for on both sides."""
        share = curved(self.stick / FULL, self.expo)
        return share * min(self.high - self.trim, self.trim - self.low)

    def stick_for(self, offset: float) -> int:
        """PWM of the RC channel that puts the servo `offset` us from its trim."""
        side = self.high - self.trim if offset > 0 else self.trim - self.low
        share = offset / side * (-1.0 if self.reversed else 1.0)
        share = straightened(share, self.expo) * (-1.0 if self.rc_reversed else 1.0)
        limit = self.stick / FULL
        share = min(max(share, -limit), limit)
        if share > 0:
            return round(self.rc_trim + self.rc_zone + share * (self.rc_high - self.rc_trim - self.rc_zone))
        if share < 0:
            return round(self.rc_trim - self.rc_zone + share * (self.rc_trim - self.rc_zone - self.rc_low))
        return round(self.rc_trim)

    @property
    def stops(self) -> str:
        """A sentence on how to stop it without the laptop."""
        switch = f"RC{self.switch} (overrides off), " if self.switch else ""
        return (
            f"stop it with {switch}the mode switch (HOLD), the rover's power, or Ctrl-C; without this "
            f"program the radio steers again after {self.lapse:g} s (RC_OVERRIDE_TIME)"
        )


def curved(x: float, expo: float) -> float:
    """ArduPilot's input_expo: (1 - e) x + e x^3."""
    return (1.0 - expo) * x + expo * x**3


def straightened(y: float, expo: float) -> float:
    """x of `curved`(x) = y, both within -1..1."""
    low, high = -1.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if curved(middle, expo) < y else (low, middle)
    return 0.5 * (low + high) if expo else y


def names_of(have: Mapping[str, float]) -> tuple[str, ...]:
    """The parameters of the steering's own channels, and of 4.7 and later, once `NAMES` are known."""
    servo, roll, throttle = _servo(have), int(have.get("RCMAP_ROLL", 1)), int(have.get("RCMAP_THROTTLE", 3))
    return (
        *(f"SERVO{servo}_{what}" for what in ("TRIM", "MIN", "MAX", "REVERSED")),
        *(f"RC{roll}_{what}" for what in ("TRIM", "MIN", "MAX", "DZ", "REVERSED")),
        *(f"RC{throttle}_{what}" for what in ("TRIM", "DZ")),
        *(() if OLD_NAME in have else NEW_NAMES),
    )


def _servo(have: Mapping[str, float]) -> int:
    """Output that steers; UsageError where there is none, several, or wheels that steer by driving."""
    steering = [n for n in CHANNELS if have.get(f"SERVO{n}_FUNCTION") == STEERING]
    if any(have.get(f"SERVO{n}_FUNCTION") in SKID for n in CHANNELS):
        raise UsageError(
            "this rover steers by its drive motors (SERVOn_FUNCTION 73 or 74): it has no steering to bench"
        )
    if len(steering) != 1:
        seen = " and ".join(f"SERVO{n}" for n in steering) or "none"
        raise UsageError(f"one output must steer (SERVOn_FUNCTION {STEERING}); this rover has {seen}")
    return steering[0]


def steering_output(have: Mapping[str, float]) -> SteeringOutput:
    """From the parameters `NAMES` and `names_of`. UsageError with the reason if a bench is not allowed."""
    _refuse(have)
    servo, roll, throttle = _servo(have), int(have.get("RCMAP_ROLL", 1)), int(have.get("RCMAP_THROTTLE", 3))
    lacking = [name for name in names_of(have) if name not in have]
    if lacking:
        raise UsageError(f"the rover did not report {', '.join(lacking)}; is the link too slow?")
    return SteeringOutput(
        servo,
        have[f"SERVO{servo}_TRIM"],
        have[f"SERVO{servo}_MIN"],
        have[f"SERVO{servo}_MAX"],
        bool(have[f"SERVO{servo}_REVERSED"]),
        roll,
        have[f"RC{roll}_TRIM"],
        have[f"RC{roll}_MIN"],
        have[f"RC{roll}_MAX"],
        have[f"RC{roll}_DZ"],
        bool(have[f"RC{roll}_REVERSED"]),
        have.get("MANUAL_STR_EXPO", 0.0),
        FULL if have.get("ARMING_RUDDER") == 0 else STICK_LIMIT,
        have["RC_OVERRIDE_TIME"],
        throttle,
        have[f"RC{throttle}_TRIM"],
        max(have[f"RC{throttle}_DZ"], 20.0),
        next((n for n in CHANNELS if have.get(f"RC{n}_OPTION") == OVERRIDE_SWITCH), 0),
        "SIM_RC_FAIL" in have,
    )


def _refuse(have: Mapping[str, float]) -> None:
    lapse = have.get("RC_OVERRIDE_TIME")
    if lapse is None or not 0 < lapse <= LONGEST_LAPSE:
        setting = "is unknown" if lapse is None else f"is {lapse:g} s"
        raise UsageError(
            f"RC_OVERRIDE_TIME {setting}; it must be above 0 and at most {LONGEST_LAPSE:g} s, so that the "
            "override lapses when this program or its link ends; set it to 3"
        )
    if int(have.get("RC_OPTIONS", 0)) & IGNORE_OVERRIDES:
        raise UsageError("RC_OPTIONS has bit 1 set (ignore MAVLink overrides): the steering would not move")
    if sentence := why_overrides_ignored(have):
        raise UsageError(sentence)
