"""Handling quantities of an identified bicycle or roll-yaw model, in the terms of ISO 8855.

In a steady turn delta = L/R + K_us a_y with K_us = (m/L) (b/Cf - a/Cr). This holds for both models: in
equation (18) the roll does not act on the tyres. K_us > 0 understeers and has a characteristic speed
sqrt(L/K_us), at which the yaw rate gain is highest; K_us < 0 oversteers and is unstable above the critical
speed sqrt(-L/K_us) (Gillespie 1992, chapter 6).

K_us = (V delta/r - L)/V^2 is a small difference: a relative error e of the steady yaw rate gain changes it by
(L/V^2 + K_us) e, at 2.4 m/s and L 0.39 m by 0.37 deg/g for 1 %. So its interval combines the Cramer-Rao bound
and the error of that gain, see `gain_error`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.geometry import FRICTION, GRAVITY, NEAR
from rover_sweep.data.recording import Note, Recording
from rover_sweep.data.results import Quantity, ShortTable, Shown, ends_words, plain_number
from rover_sweep.identification.fit import FitResult
from rover_sweep.identification.models import axle_stiffness
from rover_sweep.identification.modes import MODE_UNITS, mode_quantities
from rover_sweep.identification.state_space import ModelStructure

PEAK = 99.0  # percentile that is taken as the peak
STEP = 1e-6  # relative step of a parameter in central differences
SCALE_ERROR = 0.03  # relative: steering scale, wheelbase and speed together, as they are usually measured
UNKNOWN_SIGN = "not identified by these runs"

UNITS = {
    "understeer_gradient": ("rad s^2/m", "understeer gradient K_us"),
    "understeer_gradient_deg_per_g": ("deg/g", "understeer gradient K_us"),
    "static_margin": ("wheelbases", "neutral steer point behind the CG"),
    "critical_speed": ("m/s", "unstable above"),
    "characteristic_speed": ("m/s", "highest yaw rate gain"),
    "yaw_rate_gain": ("1/s", "steady r/delta"),
    "lateral_acceleration_gain": ("m/s^2 per rad", "steady a_y/delta, a_y = V r"),
    **MODE_UNITS,
}

OF_THE_SIGN = ("critical_speed", "characteristic_speed")  # exist for one sign of K_us only
STEADY = ("yaw_rate_gain", "lateral_acceleration_gain")
OF_BOTH_AXLES = ("understeer_gradient", "understeer_gradient_deg_per_g", "static_margin")


@dataclass(frozen=True, eq=False, repr=False)
class Handling(Shown):
    """Handling quantities {name in UNITS: value} at `speed` [m/s]; only those that exist for this rover.

    At a negative speed they are those in reverse: K_us and the static margin have the other sign there.

    Those of the modes are as in `rover_sweep.identification.modes`. tied: one cornering stiffness C
    for both axles, so that K_us follows from a, b and C.
    """

    model: str
    speed: float
    quantities: Mapping[str, Quantity]
    tied: bool

    def __getitem__(self, name: str) -> Quantity:
        return self.quantities[name]

    def get(self, name: str) -> float | None:
        """The value of a quantity, None where it does not exist for this rover."""
        return self.quantities[name].value if name in self.quantities else None

    @property
    def identified(self) -> bool:
        """True where the interval of K_us is on one side of 0, in a fit with both axles free."""
        k = self.quantities["understeer_gradient_deg_per_g"]
        return not self.tied and k.low is not None and k.high is not None and k.low * k.high > 0

    @property
    def sentence(self) -> str:
        """A sentence: understeer or oversteer with intervals, or that these runs do not identify it."""
        k = self.quantities["understeer_gradient_deg_per_g"]
        if self.tied:
            return (
                f"understeer is {UNKNOWN_SIGN} with one C for both axles: the sign of K_us "
                f"({k.value:.2g} deg/g) is that of b - a in the vehicle file"
            )
        if k.low is None or k.high is None:
            return f"understeer is {UNKNOWN_SIGN}: K_us has no interval"
        between = f"K_us {k.value:.2g} deg/g ({k.low:.2g} to {k.high:.2g})"
        if not self.identified:
            return (
                f"understeer is {UNKNOWN_SIGN}: {between}, so the rover may understeer or oversteer, and no "
                "critical or characteristic speed follows. K_us is the small difference of both axles and "
                "less certain than either stiffness"
            )
        name = "characteristic_speed" if k.value > 0 else "critical_speed"
        v = self.quantities[name]
        ends = f" ({v.low:.1f} to {v.high:.1f})" if v.low is not None and v.high is not None else ""
        kind = "understeers" if k.value > 0 else "oversteers"
        kind = f"in reverse {kind}" if self.speed < 0 else kind
        return f"the rover {kind}: {between}, {name.replace('_', ' ')} {v.value:.1f} m/s{ends}"

    def with_understeer(self, k: Quantity, base: float) -> Handling:
        """Replaces K_us [deg/g] of both axles, and the steady gains and speeds that follow from it.

        base: wheelbase [m].
        """
        low, high = k.interval_90 or (None, None)
        per_g = "understeer_gradient_deg_per_g"
        of_k = (*OF_BOTH_AXLES, *OF_THE_SIGN, *STEADY)
        kept = {n: q for n, q in self.quantities.items() if n not in of_k}
        both = {per_g: _quantity(per_g, k.value, low=low, high=high)}
        gains = [self._gain(x, base) for x in (k.value, low, high) if x is not None]
        for name, factor in zip(STEADY, (1.0, self.speed), strict=True):
            limits = (factor * min(gains), factor * max(gains)) if len(gains) == 3 else (None, None)
            both[name] = _quantity(name, factor * gains[0], low=limits[0], high=limits[1])
        if k.value:
            name = "characteristic_speed" if k.value > 0 else "critical_speed"
            both[name] = _quantity(name, _speed(k.value, base))
            if low is not None and high is not None and low * high > 0:
                ends = sorted(_speed(end, base) for end in (low, high))
                both[name] = replace(both[name], low=ends[0], high=ends[1])
        found = {n: q for n in UNITS for q in ((both | kept).get(n),) if q is not None}
        return replace(self, quantities=found, tied=False)

    def _gain(self, per_g: float, base: float) -> float:
        """Steady r/delta [1/s], V/(L + K_us V^2), of a K_us [deg/g]."""
        return self.speed / (base + np.radians(per_g) / GRAVITY * self.speed**2)

    def table(self) -> ShortTable:
        """The quantities that these runs identify, with their intervals."""
        rows = tuple(
            (name, plain_number(q.value), ends_words(q.low, q.high), q.unit) for name, q in self.told.items()
        )
        title = f"handling of the {self.model} model at {self.speed:.2f} m/s"
        return ShortTable(title, ("quantity", "value", "interval", "unit"), rows, (self.sentence,))

    @property
    def told(self) -> dict[str, Quantity]:
        """The quantities to print: without those that follow from K_us where it is not identified."""
        left_out = () if self.identified else OF_THE_SIGN
        left_out = (*left_out, *OF_BOTH_AXLES) if self.tied else left_out
        return {n: q for n, q in self.quantities.items() if n not in left_out}


def _speed(per_g: float, base: float) -> float:
    """Characteristic or critical speed [m/s] of K_us [deg/g]."""
    return float(np.sqrt(base * GRAVITY / abs(np.radians(per_g))))


def gain_error(runs: Sequence[Recording]) -> float:
    """Bound of the relative error of the models' steady yaw rate gain, the sum of three parts.

    The speed drop in turns (standard deviation over mean), 1 - cos of the largest angle (a steered force acts
    across the rover by cos(delta) only), and `SCALE_ERROR`.
    """
    speeds = [run.manoeuvre("speed").x for run in runs]
    drops = [float(np.std(speed) / abs(np.mean(speed))) for speed in speeds]
    return max(drops, default=0.0) + force_turned(runs) + SCALE_ERROR


def force_turned(runs: Sequence[Recording]) -> float:
    """Share of the front axle's force that is not across the rover at the largest steering angle."""
    angles = [float(np.percentile(np.abs(run.manoeuvre("delta").x), PEAK)) for run in runs]
    return 1.0 - float(np.cos(max(angles, default=0.0)))


def handling(
    fit: FitResult, speed: float | None = None, error: float = 0.0, modes_of: FitResult | None = None
) -> Handling:
    """Handling quantities of a fitted bicycle or roll-yaw model. speed [m/s]: default that of the fit.

    Bounds: sqrt(s^T P s), with the slopes s to the free parameters and their covariance P; fixed parameters
    count as exact. error: see `gain_error`; it widens the intervals. modes_of: the fit that gives the modes,
    default the same; their intervals are from its bootstrap, at its speed. ValueError for a model without
    cornering stiffness.
    """
    structure, v = fit.structure, fit.speed if speed is None else speed
    if not has_handling(structure):
        raise ValueError(
            f"the {structure.name} model has no cornering stiffness, so it gives no handling quantities"
        )
    values = _quantities(structure, v)
    slopes = _slopes(structure, v, values)
    found = {n: _quantity(n, x, bound=_bound(slopes[n], fit.covariance)) for n, x in values.items()}
    found = {
        n: _with_interval(q, _model_error(n, structure, fit.speed, found, error)) for n, q in found.items()
    }
    moving = modes_of or fit
    modes = mode_quantities(moving.structure, v, moving.mode_intervals if v == moving.speed else ())
    quantities = {**_with_speeds(found, structure), **dict(modes)}
    return Handling(structure.name, v, quantities, tied="C" in structure.values)


def _model_error(
    name: str, structure: ModelStructure, speed: float, found: Mapping[str, Quantity], error: float
) -> float:
    """The change of a quantity by a relative error of the yaw rate gain at the runs' speed [m/s]."""
    p = structure.values
    cf, cr = axle_stiffness(p)
    of_k = error * abs((p["a"] + p["b"]) / speed**2 + found["understeer_gradient"].value)
    return {
        "understeer_gradient": of_k,
        "understeer_gradient_deg_per_g": float(np.degrees(of_k)) * GRAVITY,
        "static_margin": of_k * cf * cr / (p["m"] * (cf + cr)),
        "yaw_rate_gain": error * abs(found[name].value),
        "lateral_acceleration_gain": error * abs(found[name].value),
    }.get(name, 0.0)


def _with_interval(q: Quantity, error: float) -> Quantity:
    if q.bound is None or not np.isfinite(q.value):
        return q
    return replace(q, low=q.value - q.bound - error, high=q.value + q.bound + error)


def _with_speeds(found: Mapping[str, Quantity], structure: ModelStructure) -> dict[str, Quantity]:
    """With intervals of the critical or characteristic speed from that of K_us; none where it holds 0."""
    k, base = found["understeer_gradient"], structure.values["a"] + structure.values["b"]
    if k.low is None or k.high is None or k.low * k.high <= 0:
        return {n: replace(q, low=None, high=None) if n in OF_THE_SIGN else q for n, q in found.items()}
    low, high = sorted(float(np.sqrt(base / abs(end))) for end in (k.low, k.high))
    return {n: replace(q, low=low, high=high) if n in OF_THE_SIGN else q for n, q in found.items()}


def has_handling(structure: ModelStructure) -> bool:
    """True for a model with axle distances, cornering stiffness, mass and yaw inertia."""
    known = structure.values
    return {"a", "b", "m", "Izz"} <= set(known) and ("C" in known or {"Cf", "Cr"} <= set(known))


def _quantities(structure: ModelStructure, speed: float) -> dict[str, float]:
    p = structure.values
    cf, cr = axle_stiffness(p)
    m, a, b = p["m"], p["a"], p["b"]
    base = a + b
    way = -1.0 if speed < 0 else 1.0
    k = way * m / base * (b / cf - a / cr)
    turning = base + k * speed**2
    out = {
        "understeer_gradient": k,
        "understeer_gradient_deg_per_g": float(np.degrees(k)) * GRAVITY,
        "static_margin": way * (b * cr - a * cf) / (base * (cf + cr)),
        "yaw_rate_gain": speed / turning if turning else np.inf,
        "lateral_acceleration_gain": speed**2 / turning if turning else np.inf,
    }
    if k:
        name = "characteristic_speed" if k > 0 else "critical_speed"
        out[name] = float(np.sqrt(base / abs(k)))
    return {n: x for n in UNITS if (x := out.get(n)) is not None}


def _slopes(structure: ModelStructure, speed: float, values: Mapping[str, float]) -> dict[str, np.ndarray]:
    """d quantity / d theta (n_free,) by central differences; nan where it exists on one side only."""
    columns: dict[str, list[float]] = {n: [] for n in values}
    for p in structure.free:
        step = STEP * (abs(p.value) or 1.0)
        up, down = (_quantities(structure.with_values({p.name: p.value + s}), speed) for s in (step, -step))
        for n, column in columns.items():
            column.append((up.get(n, np.nan) - down.get(n, np.nan)) / (2 * step))
    return {n: np.array(column) for n, column in columns.items()}


def _quantity(name: str, value: float, **known: float | None) -> Quantity:
    unit, meaning = UNITS[name]
    return Quantity(name, unit, value, meaning=meaning, **known)


def _bound(slope: np.ndarray, covariance: np.ndarray | None) -> float | None:
    if covariance is None:
        return None
    variance = float(slope @ covariance @ slope)
    return float(np.sqrt(variance)) if np.isfinite(variance) and variance >= 0 else None


# Warnings of runs near the critical speed or the friction limit.


def warnings(
    found: Handling | None, runs: Sequence[Recording], friction: float | None = None
) -> tuple[Note, ...]:
    """Warnings of runs close to the critical speed or with a peak a_y close to the friction limit.

    found: gives the critical speed. friction: peak side force of the tyres over their load, 0.5 when None.
    a_y is V r, because an accelerometer's signal also contains roll and vibration.
    """
    notes = []
    critical = found.get("critical_speed") if found else None
    for run in runs:
        if critical and (speed := _fastest(run)) > NEAR * critical:
            notes.append(
                f"{run.name}: {speed:.2f} m/s is {100 * speed / critical:.0f} % of the critical speed "
                f"{critical:.2f} m/s ({found.model if found else ''} model), above which the rover spins "
                "without countersteering: drive slower"
            )
        limit = (friction or FRICTION) * GRAVITY
        if (peak := peak_lateral_acceleration(run)) > NEAR * limit:
            source = "friction of the vehicle file" if friction else f"friction {FRICTION:g}, assumed"
            remedy = (
                "" if friction else ", or give the friction of the ground in the vehicle file if it is higher"
            )
            notes.append(
                f"{run.name}: a_y reaches {peak:.1f} m/s^2, {100 * peak / limit:.0f} % of the friction limit "
                f"{limit:.1f} m/s^2 ({source}), where tyres are not linear: reduce amplitude or speed{remedy}"
            )
    return tuple(Note("warning", text) for text in notes)


def _fastest(run: Recording) -> float:
    return float(np.percentile(np.abs(run.manoeuvre("speed").x), PEAK))


def peak_lateral_acceleration(run: Recording) -> float:
    """99th percentile of |V r| over the manoeuvre, m/s^2."""
    r, speed = run.manoeuvre("r"), run["speed"]
    return float(np.percentile(np.abs(r.x * np.interp(r.t, speed.t, speed.x)), PEAK))
