"""The rover's radio control: a simulated transmitter, the ground station's overrides, switches, failsafe.

Rules of Rover-4.6.3 (RC_Channel.cpp, RC_Channels.cpp, GCS_Common.cpp): an override of 0 on channels 1-8
gives the channel back, 65535 leaves it; on 9-16 65534 gives it back and 0 leaves it. An override lasts
RC_OVERRIDE_TIME. Switches are read at 10 Hz, low below 1200 us, high above 1800, 200 ms debounced.
"""

from __future__ import annotations

from collections.abc import Sequence

from sitl.autopilot.vehicle_parameters import ParameterStore

CHANNELS = 16
TRANSMITTER = (1500, 1500, 1500, 1500, 1800, 1000, 1000, 1800)  # sticks and switches of ArduPilot's SITL
CHANNEL_COUNT = len(TRANSMITTER)
LEAVE, GIVE_BACK = 65535, 65534
DEBOUNCE_MS = 200
MODE_SWITCH_LIMITS = (1231, 1361, 1491, 1621, 1750)
NO_SIGNAL = (800, 2200)  # RC_MIN_LIMIT_PWM, RC_MAX_LIMIT_PWM: no switch position outside
NO_PULSES, THROTTLE_LOST = 1, 2  # SIM_RC_FAIL


class Debounce:
    """A switch position counts after 200 ms without change."""

    def __init__(self) -> None:
        self.position = -1
        self._candidate = -1
        self._since_ms = 0

    def changed(self, position: int, now_ms: int) -> bool:
        """True when `position` has just become the established one."""
        if position == self.position:
            self._candidate = position
        elif position != self._candidate:
            self._candidate, self._since_ms = position, now_ms
        elif now_ms - self._since_ms >= DEBOUNCE_MS:
            self.position = position
            return True
        return False


class Radio:
    """RC input of 16 channels [us]. `pwm` is what the vehicle acts on; `update` refreshes it at 50 Hz."""

    def __init__(self, parameters: ParameterStore) -> None:
        self.parameters = parameters
        self.pwm = [0] * CHANNELS
        self.last_valid_ms = 0
        self.seen = False
        self.transmitter = list(TRANSMITTER)  # where its sticks and switches are
        self._receiver = [*TRANSMITTER, *([0] * (CHANNELS - CHANNEL_COUNT))]
        self._overrides: list[tuple[int, int]] = [(0, 0)] * CHANNELS
        self._new_override = False
        self._switches = [Debounce() for _ in range(CHANNELS)]
        self._mode_switch = Debounce()

    def override(self, values: Sequence[int], now_ms: int) -> None:
        """RC_CHANNELS_OVERRIDE: up to 16 values in us with the protocol's meaning of 0, 65534 and 65535."""
        for n, value in enumerate(values[:CHANNELS]):
            if value == LEAVE or (n >= 8 and value == 0):
                continue
            self.set_override(n + 1, 0 if n >= 8 and value == GIVE_BACK else value, now_ms)

    def set_override(self, channel: int, us: int, now_ms: int) -> None:
        """Override channel 1..16, or give it back with 0 (RC_Channel::set_override)."""
        self._overrides[channel - 1] = (us, now_ms)
        self._new_override = True

    def clear_overrides(self) -> None:
        self._overrides = [(0, 0)] * CHANNELS

    def overridden(self, channel: int, now_ms: int) -> bool:
        """Whether an override of channel 0..15 holds now."""
        value, since = self._overrides[channel]
        timeout = self.parameters["RC_OVERRIDE_TIME"]
        if value == 0 or timeout == 0:
            return False
        return timeout < 0 or now_ms - since < timeout * 1000

    def update(self, now_ms: int) -> None:
        """Takes in the receiver and the overrides, as Rover::read_radio at 50 Hz."""
        fail = self.parameters["SIM_RC_FAIL"]
        if fail == NO_PULSES:
            if not self._new_override:
                return
        else:
            neutral = [1500, 1500, 950, *([1500] * 5)]
            self._receiver[:CHANNEL_COUNT] = neutral if fail == THROTTLE_LOST else self.transmitter
        self._new_override = False
        self.seen = True
        self.last_valid_ms = now_ms
        for n in range(CHANNELS):
            self.pwm[n] = self._overrides[n][0] if self.overridden(n, now_ms) else self._receiver[n]

    def lost(self, now_ms: int) -> bool:
        """Radio failsafe condition: no input for 0.5 s, or throttle below FS_THR_VALUE."""
        throttle = self.pwm[int(self.parameters["RCMAP_THROTTLE"]) - 1]
        return throttle < self.parameters["FS_THR_VALUE"] or now_ms - self.last_valid_ms > 500

    def angle(self, channel: int, full: float) -> float:
        """Stick of channel 1..16 as -full..full about its trim, without its dead zone; a whole number."""
        p = self.parameters
        pwm, trim, zone = self.pwm[channel - 1], p[f"RC{channel}_TRIM"], p[f"RC{channel}_DZ"]
        sign = -1 if p[f"RC{channel}_REVERSED"] else 1
        low, high = trim - zone, trim + zone
        if pwm > high and p[f"RC{channel}_MAX"] != high:
            return sign * int(full * (pwm - high) / (p[f"RC{channel}_MAX"] - high))
        if pwm < low and p[f"RC{channel}_MIN"] != low:
            return sign * int(full * (pwm - low) / (low - p[f"RC{channel}_MIN"]))
        return 0

    def neutral(self, channel: int) -> bool:
        """Whether the stick of channel 1..16 is within its dead zone."""
        p = self.parameters
        return abs(self.pwm[channel - 1] - p[f"RC{channel}_TRIM"]) <= max(p[f"RC{channel}_DZ"], 1)

    def switch_changes(self, now_ms: int) -> list[tuple[int, int, int]]:
        """(channel 1..16, function, position 0..2) of the switches that have just settled; call at 10 Hz."""
        changes = []
        for n in range(CHANNELS):
            function, pwm = int(self.parameters[f"RC{n + 1}_OPTION"]), self.pwm[n]
            if function == 0 or not NO_SIGNAL[0] < pwm < NO_SIGNAL[1]:
                continue
            position = 0 if pwm < 1200 else 2 if pwm > 1800 else 1
            if self._switches[n].changed(position, now_ms):
                changes.append((n + 1, function, position))
        return changes

    def mode_switch_change(self, now_ms: int) -> int | None:
        """Position 1..6 of the mode switch when it has just settled, else None; call at 7 Hz."""
        channel = int(self.parameters["MODE_CH"])
        if not 1 <= channel <= CHANNELS or not self.seen:
            return None
        pwm = self.pwm[channel - 1]
        if not NO_SIGNAL[0] < pwm < NO_SIGNAL[1]:
            return None
        position = 1 + sum(pwm >= limit for limit in MODE_SWITCH_LIMITS)
        return position if self._mode_switch.changed(position, now_ms) else None
