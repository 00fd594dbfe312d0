"""The rover's servo outputs: pilot's steering and throttle in us, and overrides by scripts.

Rules of Rover-4.6.3 (SRV_Channel.cpp, AP_MotorsUGV.cpp): an output computed from the pilot stays within
SERVOn_MIN..MAX; steering moves disarmed too, throttle then stays at its trim; throttle is slew limited.
A script's override goes out as it is, for a number of main loops, armed or not, and is NOT limited to
SERVOn_MIN..MAX (SRV_Channels::set_output_pwm_chan_timeout), so the applet has to limit itself.
"""

from __future__ import annotations

from sitl.autopilot.vehicle_parameters import Parameter, ParameterStore

CHANNELS = 16
STEERING, THROTTLE = 26, 70  # SERVOn_FUNCTION
STEERING_FULL, THROTTLE_FULL = 4500.0, 100.0


class ServoOutputs:
    """16 outputs in us (0: the channel has no function). `update` runs once a main loop."""

    def __init__(self, parameters: ParameterStore, loop_period_us: int) -> None:
        self.parameters = parameters
        self.loop_period_us = loop_period_us
        self.pwm = [0] * CHANNELS
        self.steering = self.throttle = 0.0
        self._loops_left = [0] * CHANNELS
        self._override = [0] * CHANNELS
        self._functions: list[int] = []
        self._assign()
        parameters.on_change.append(self._parameter_changed)

    def override(self, channel: int, pwm: int, timeout_ms: int) -> None:
        """Puts `pwm` on output 0..15 for ceil(timeout / loop period) main loops, readable at once."""
        if not 0 <= channel < CHANNELS:
            return
        self._loops_left[channel] = min(-(-timeout_ms * 1000 // self.loop_period_us), 65535)
        self._override[channel] = self.pwm[channel] = pwm

    def update(self, steering: float, throttle: float, armed: bool) -> None:
        """steering -4500..4500 (clockwise positive), throttle -100..100 of the mode that drives."""
        self.steering = steering
        change = self.parameters["MOT_SLEWRATE"] * self.loop_period_us * 1e-6
        wanted = throttle if armed else 0.0
        if change > 0 and armed:
            wanted = min(max(wanted, self.throttle - change), self.throttle + change)
        self.throttle = wanted
        for n in range(CHANNELS):
            if self._loops_left[n] > 0:
                self._loops_left[n] -= 1
                self.pwm[n] = self._override[n]
                continue
            function = self._functions[n]
            if function == STEERING:
                self.pwm[n] = self.scaled(n + 1, steering / STEERING_FULL)
            elif function == THROTTLE:
                self.pwm[n] = self.scaled(n + 1, self.throttle / THROTTLE_FULL)
            else:
                self.pwm[n] = 0

    def scaled(self, number: int, value: float) -> int:
        """PWM of servo 1..16 for -1..1 about its trim, cut to whole us."""
        p = self.parameters
        trim = int(p[f"SERVO{number}_TRIM"])
        value = min(max(-value if p[f"SERVO{number}_REVERSED"] else value, -1.0), 1.0)
        if value > 0:
            return trim + int(value * (p[f"SERVO{number}_MAX"] - trim))
        return trim - int(-value * (trim - p[f"SERVO{number}_MIN"]))

    def channel_of(self, function: int) -> int | None:
        """First output (0-based) with that SERVOn_FUNCTION, None without one."""
        return self._functions.index(function) if function in self._functions else None

    def _assign(self) -> None:
        self._functions = [int(self.parameters[f"SERVO{n + 1}_FUNCTION"]) for n in range(CHANNELS)]

    def _parameter_changed(self, parameter: Parameter) -> None:
        if parameter.name.endswith("_FUNCTION"):
            self._assign()
