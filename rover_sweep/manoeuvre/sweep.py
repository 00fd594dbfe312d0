"""Test inputs in closed form: the exponential sweep of the paper, about a bias, on the throttle; a doublet.

The applet on the vehicle drives exactly these waves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np

from firmware_params.applet_parameters import PARAMETERS, PREFIX, TYPES, for_manoeuvre
from rover_sweep.errors import UsageError
from rover_sweep.manoeuvre.multisine import Array, Multisine, fading

C1 = 4.0  # Tischler & Remple 2012, chapter 5; equation (5) of the paper is misprinted, see `Sweep.rate`
C2 = 0.0187


@dataclass(frozen=True)
class Sweep:
    """A frequency sweep: amplitude [us], w_min, w_max [rad/s], t_rec, fade, dwell, straight [s].

    Order in time: straight, fade-in at w_min, dwell at w_min, sweep over t_rec, fade-out at the final
    frequency, straight. Fade and dwell are outside t_rec.
    """

    amplitude: float = 150.0
    w_min: float = 0.3
    w_max: float = 25.0
    t_rec: float = 55.0
    fade: float = 2.0
    dwell: float = 2.0
    straight: float = 3.0
    kind: Literal["sweep", "bias_sweep", "throttle"] = "sweep"

    def __post_init__(self) -> None:
        if not 0 < self.w_min < self.w_max:
            raise ValueError(f"need 0 < w_min < w_max, got w_min {self.w_min} and w_max {self.w_max} rad/s")
        if self.t_rec <= 0 or self.amplitude <= 0:
            raise ValueError(f"need t_rec > 0 and amplitude > 0, got {self.t_rec} s and {self.amplitude} us")
        if min(self.fade, self.dwell, self.straight) < 0:
            raise ValueError(
                f"fade {self.fade}, dwell {self.dwell}, straight {self.straight} s must not be negative"
            )

    @property
    def duration(self) -> float:
        """Length of the whole override, s."""
        return 2 * self.straight + 2 * self.fade + self.dwell + self.t_rec

    @property
    def law_start(self) -> float:
        """Time from the start of the override at which T_rec begins, s."""
        return self.straight + self.fade + self.dwell

    def rate(self, t: Array | float) -> Array:
        """Frequency (...) [rad/s] at t (...) [s] from the start of t_rec, constant outside 0..t_rec.

        w(t) = w_min + C2 (e^(C1 t/T_rec) - 1)(w_max - w_min): equation (5) of the paper, corrected by
        Tischler & Remple (as printed, w stays at w_min). It ends .23 % of the span above w_max, as C2 is
        rounded.
        """
        s = np.clip(t, 0.0, self.t_rec)
        return self.w_min + C2 * np.expm1(C1 * s / self.t_rec) * (self.w_max - self.w_min)

    def phase(self, t: Array | float) -> Array:
        """Phase theta (...) [rad] at t (...) [s] from the start of t_rec, equation (4); 0 at t = 0.

        Outside t_rec the frequency is constant, so the phase is linear.
        """
        s = np.clip(t, 0.0, self.t_rec)
        law = (self.w_max - self.w_min) * C2 * (self.t_rec / C1 * np.expm1(C1 * s / self.t_rec) - s)
        before, after = np.minimum(t, 0.0), np.maximum(np.asarray(t) - self.t_rec, 0.0)
        return self.w_min * (s + before) + law + self.rate(self.t_rec) * after

    def wave(self, t: Array | float) -> Array:
        """Steering offset [us] at t [s] from the start of the override; phase 0 at the start of fade-in."""
        since_fade = np.asarray(t, dtype=float) - self.straight
        law_time = since_fade - self.fade - self.dwell
        start_phase = self.w_min * (self.fade + self.dwell)
        full = self.middle + self.amplitude * np.sin(self.phase(law_time) + start_phase)
        return fading(since_fade, self.dwell + self.t_rec, self.fade) * full

    @property
    def middle(self) -> float:
        """Mean steering offset from trim, us."""
        return 0.0

    @property
    def peak(self) -> float:
        """Largest offset from trim, us."""
        return self.amplitude + abs(self.middle)

    @property
    def peak_slew(self) -> float:
        """Largest rate of the wave at the servo, us/s."""
        return self.amplitude * float(self.rate(self.t_rec))


@dataclass(frozen=True)
class BiasSweep(Sweep):
    """A sweep about a steering offset: bias [us], positive for larger PWM, faded in and out with the sweep.

    Even nonlinearities (a saturating tyre, a quadratic linkage) show as a difference to the response of a
    sweep about straight.
    """

    bias: float = 100.0
    kind: Literal["sweep", "bias_sweep", "throttle"] = "bias_sweep"

    @property
    def middle(self) -> float:
        """Mean steering offset from trim, us."""
        return self.bias


@dataclass(frozen=True)
class ThrottleSweep(Sweep):
    """A sweep of the throttle [us] about the pilot's, who steers: for the response of the speed.

    Slower than a steering sweep: a rover's speed lags its throttle by about a second.
    """

    amplitude: float = 60.0
    w_min: float = 0.2
    w_max: float = 8.0
    t_rec: float = 60.0
    kind: Literal["sweep", "bias_sweep", "throttle"] = "throttle"


@dataclass(frozen=True)
class Doublet:
    """Alternating steps for verification: `count` doublets (+A then -A, `pulse` s each), `pause` s apart."""

    amplitude: float = 150.0
    pulse: float = 1.0
    pause: float = 2.0
    count: int = 2
    straight: float = 3.0
    kind: Literal["doublet"] = "doublet"

    @property
    def peak(self) -> float:
        """Largest offset from trim, us."""
        return self.amplitude

    @property
    def duration(self) -> float:
        """Length of the whole override, s."""
        return 2 * self.straight + self.count * (2 * self.pulse + self.pause)

    def wave(self, t: Array | float) -> Array:
        """Steering offset [us] at t [s] from the start of the override."""
        since = np.asarray(t, dtype=float) - self.straight
        period = 2 * self.pulse + self.pause
        into = np.mod(since, period)
        active = (since >= 0) & (since < self.count * period)
        first, second = into < self.pulse, (into >= self.pulse) & (into < 2 * self.pulse)
        return np.asarray(self.amplitude * active * (1.0 * first - 1.0 * second), dtype=np.float64)


Manoeuvre = Sweep | Doublet | Multisine

# The runs of a session that names none. What depends on the amplitude shows between the two sweeps; the
# doublet verifies.
FIRST_SWEEPS = (Sweep(amplitude=120.0), Sweep(amplitude=240.0))
FIRST_DOUBLET = Doublet()


def long_periods(sweep: Sweep) -> float:
    """Number of periods of w_min in T_rec; in all runs 4..5 are advised (Tischler & Remple 2012)."""
    return sweep.t_rec * sweep.w_min / (2 * math.pi)


# A manoeuvre as the parameters of the applet.


LEAST_SAMPLES = 10  # per period of the highest frequency


def parameters_of(manoeuvre: Manoeuvre, **others: float) -> dict[str, float]:
    """SWP_ parameters [us, rad/s, s] that make the applet drive this manoeuvre.

    others: further parameters, such as limits, by the applet's names without prefix (v_max, roll_max, ...).
    UsageError for values that the applet would refuse.
    """
    numbers = asdict(manoeuvre)
    if twice := sorted(numbers.keys() & others.keys()):
        raise UsageError(f"{', '.join(twice)}: set by the manoeuvre; remove it from the limits")
    try:
        return for_manoeuvre(numbers.pop("kind"), **numbers, **others)
    except ValueError as error:
        raise UsageError(str(error)) from error


def refuse_undersampled(manoeuvre: Manoeuvre, loop_rate: float) -> None:
    """UsageError when w_max is too high for a SCHED_LOOP_RATE [Hz]: below 10 samples per period."""
    top = 2 * math.pi * loop_rate / LEAST_SAMPLES
    if isinstance(manoeuvre, Sweep | Multisine) and manoeuvre.w_max > top:
        samples = 2 * math.pi * loop_rate / manoeuvre.w_max
        raise UsageError(
            f"w_max {manoeuvre.w_max:g} rad/s has {samples:.1f} samples per period at the loop rate of "
            f"{loop_rate:g} Hz, but {LEAST_SAMPLES} are needed: use {math.floor(top):g} rad/s or less"
        )


# The manoeuvre configured in the applet's parameters.


DEFAULTS = {p.name: p.default for p in PARAMETERS}


def configured_manoeuvre(values: Mapping[str, float]) -> Manoeuvre | None:
    """The manoeuvre of these SWP_ parameters [us, rad/s, s]; missing ones have their defaults.

    None without any SWP_ parameter, or for values that the applet would refuse.
    """
    if not any(name.startswith(PREFIX) for name in values):
        return None
    known = {**DEFAULTS, **values}
    try:
        return _made(known)
    except ValueError:
        return None


def _made(known: Mapping[str, float]) -> Manoeuvre | None:
    amplitude, count = known["SWP_AMP"], round(known["SWP_COUNT"])
    straight, fade, dwell = (known[f"SWP_{name}"] for name in ("STRAIGHT", "FADE", "DWELL"))
    kind = next((kind for kind, number in TYPES.items() if number == round(known["SWP_TYPE"])), "")
    if kind == "doublet":
        return Doublet(amplitude, known["SWP_PULSE"], known["SWP_PAUSE"], count, straight)
    low, high, length = known["SWP_WMIN"], known["SWP_WMAX"], known["SWP_TREC"]
    if kind == "multisine":
        return Multisine(amplitude, low, high, length, count, fade, dwell, straight)
    if kind == "bias_sweep":
        return BiasSweep(amplitude, low, high, length, fade, dwell, straight, bias=known["SWP_BIAS"])
    if kind == "throttle":
        return ThrottleSweep(amplitude, low, high, length, fade, dwell, straight)
    return Sweep(amplitude, low, high, length, fade, dwell, straight) if kind == "sweep" else None
