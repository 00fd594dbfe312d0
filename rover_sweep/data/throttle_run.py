"""One recorded throttle sweep: throttle output and speed on one clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rover_sweep.data.recording import Array, Signal


@dataclass(frozen=True, eq=False)
class ThrottleRun:
    """A throttle sweep and the coasting after it.

    pwm: throttle output [us], a staircase; speed: along the heading [m/s], of the EKF. span: (start, end) s
    of the applet's override. swept: frequencies (lowest, highest) [rad/s] of the sweep. parameters: of the
    autopilot, by name. stopped: why the applet ended it early, "" if not. sources: (path name, sha256).
    """

    name: str
    pwm: Signal
    speed: Signal
    span: tuple[float, float]
    swept: tuple[float, float]
    parameters: Mapping[str, float] = field(default_factory=dict)
    stopped: str = ""
    firmware: str = ""
    sources: tuple[tuple[str, str], ...] = ()

    @property
    def neutral_us(self) -> float:
        """PWM of the standing motor."""
        return self._output("TRIM", 1500.0)

    @property
    def travel_us(self) -> float:
        """PWM from neutral to full throttle, negative for a reversed output."""
        forward = not self._output("REVERSED", 0.0)
        return (self._output("MAX", 1900.0) if forward else self._output("MIN", 1100.0)) - self.neutral_us

    def drive(self, t: Array) -> Array:
        """Throttle (n,) as a share of full, averaged over the cells around an even grid t (n,) [s]."""
        return (self.pwm.on(t) - self.neutral_us) / self.travel_us

    def _output(self, key: str, usual: float) -> float:
        outputs = (n for n in range(1, 17) if self.parameters.get(f"SERVO{n}_FUNCTION") == THROTTLE_FUNCTION)
        return self.parameters.get(f"SERVO{next(outputs, 3)}_{key}", usual)


THROTTLE_FUNCTION = 70  # SERVOn_FUNCTION of the motor
