"""Why ArduRover does not arm: its checks before and at arming, each with the firmware's own words.

Rover-4.6.3: Rover/AP_Arming.cpp, AP_Arming.cpp (`manual_transmitter_checks`, `servo_checks`,
`rc_arm_checks`), AP_MotorsUGV.cpp (`pre_arm_check`), RC_Channels (`duplicate_options_exist`,
`flight_mode_channel_conflicts_with_rc_option`). MAV_CMD_RUN_PREARM_CHECKS runs `before_arming`, SYS_STATUS
reports it; `at_arming` runs only when somebody arms. Left out: sensors, battery, fence, logging.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

from sitl.autopilot.radio import CHANNEL_COUNT, CHANNELS, Radio
from sitl.autopilot.servo_outputs import STEERING, THROTTLE
from sitl.autopilot.vehicle_parameters import ParameterStore

CALIBRATED = (1300, 1700)  # us: RC_CALIB_MIN_LIMIT_PWM, RC_CALIB_MAX_LIMIT_PWM
ALL, RC, SYSTEM = 1 << 0, 1 << 6, 1 << 13  # ARMING_CHECK
STICKS = (("Roll", "RCMAP_ROLL"), ("Throttle", "RCMAP_THROTTLE"))


def before_arming(
    parameters: ParameterStore, radio_failsafe: bool, script_error: str | None
) -> tuple[str, ...]:
    """The failed checks of a disarmed rover, without the firmware's "PreArm: " or "Arm: "."""
    if parameters["ARMING_CHECK"] == 0:
        return ()
    transmitter = () if not _enabled(parameters, RC) else _transmitter(parameters, radio_failsafe)
    script = (
        () if script_error is None or not _enabled(parameters, SYSTEM) else (f"Scripting: {script_error}",)
    )
    return (*transmitter, *_servos(parameters), *script, *_motors(parameters))


def at_arming(parameters: ParameterStore, radio: Radio) -> tuple[str, ...]:
    """The failed checks that are made only at arming, while the radio is heard."""
    if parameters["ARMING_CHECK"] == 0 or not _enabled(parameters, RC):
        return ()
    neutral = (
        f"{name} (RC{number}) is not neutral"
        for name, channel in STICKS
        if not radio.neutral(number := int(parameters[channel]))
    )
    return tuple(chain(_options(parameters), neutral))


def _enabled(parameters: ParameterStore, check: int) -> bool:
    return bool(int(parameters["ARMING_CHECK"]) & (ALL | check))


def _transmitter(parameters: ParameterStore, failsafe: bool) -> tuple[str, ...]:
    if failsafe:
        return ("Radio failsafe on",)
    for name, channel in (("Steer", "RCMAP_ROLL"), ("Throttle", "RCMAP_THROTTLE")):
        stick = f"RC{int(parameters[channel])}"
        if parameters[f"{stick}_MIN"] > CALIBRATED[0]:
            return (f"{name} radio min too high",)
        if parameters[f"{stick}_MAX"] < CALIBRATED[1]:
            return (f"{name} radio max too low",)
    return tuple(_about_trim(parameters, "RC", range(1, CHANNEL_COUNT + 1)))


def _servos(parameters: ParameterStore) -> Iterator[str]:
    used = [n for n in range(1, CHANNELS + 1) if parameters[f"SERVO{n}_FUNCTION"] > 0]
    return _about_trim(parameters, "SERVO", used)


def _about_trim(parameters: ParameterStore, kind: str, numbers: range | list[int]) -> Iterator[str]:
    for n in numbers:
        name = f"{kind}{n}"
        if parameters[f"{name}_MIN"] > parameters[f"{name}_TRIM"]:
            yield f"{name}_MIN is greater than {name}_TRIM"
        if parameters[f"{name}_MAX"] < parameters[f"{name}_TRIM"]:
            yield f"{name}_MAX is less than {name}_TRIM"


def _motors(parameters: ParameterStore) -> Iterator[str]:
    functions = {int(parameters[f"SERVO{n}_FUNCTION"]) for n in range(1, CHANNELS + 1)}
    if not functions & {STEERING, THROTTLE, 73, 74}:
        yield "no motor, sail or scripting outputs defined"
    elif (73 in functions) != (74 in functions):
        yield "check skid steering config"
    elif (STEERING in functions) != (THROTTLE in functions):
        yield "check steering and throttle config"


def _options(parameters: ParameterStore) -> Iterator[str]:
    options = [int(parameters[f"RC{n}_OPTION"]) for n in range(1, CHANNELS + 1)]
    used = [option for option in options if option != 0]
    if len(set(used)) < len(used):
        yield "Duplicate Aux Switch Options"
    mode = int(parameters["MODE_CH"])
    if 0 < mode < CHANNELS and options[mode - 1] != 0:
        yield f"Mode channel and RC{mode}_OPTION conflict"
