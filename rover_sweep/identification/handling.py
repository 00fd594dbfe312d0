"""Handling quantities of an identified bicycle or roll-yaw model, in the terms of ISO 8855.

In a steady turn delta = L/R + K_us a_y with K_us = (m/L) (b/Cf - a/Cr). This holds for both models: in
equation (18) the roll does not act on the tyres. K_us > 0 understeers and has a characteristic speed
sqrt(L/K_us), at which the yaw rate gain is highest; K_us < 0 oversteers and is unstable above the critical
speed sqrt(-L/K_us) (Gillespie 1992, chapter 6).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rover_sweep.data.geometry import FRICTION, GRAVITY, NEAR
from rover_sweep.data.recording import Note, Recording
from rover_sweep.data.result_table import ShortTable, Shown, plain_number
from rover_sweep.identification.fit import FitResult
from rover_sweep.identification.models.bicycle import axle_stiffness
from rover_sweep.identification.structure.state_space import ModelStructure

PEAK = 99.0  # percentile of |a_y| that is taken as its peak
STEP = 1e-6  # relative step of a parameter in central differences

UNITS = {
    "understeer_gradient": ("rad s^2/m", "understeer gradient K_us"),
    "understeer_gradient_deg_per_g": ("deg/g", "understeer gradient K_us"),
    "static_margin": ("wheelbases", "neutral steer point behind the CG"),
    "critical_speed": ("m/s", "unstable above"),
    "characteristic_speed": ("m/s", "highest yaw rate gain"),
    "yaw_rate_gain": ("1/s", "steady r/delta"),
    "lateral_acceleration_gain": ("m/s^2 per rad", "steady a_y/delta, a_y = V r"),
    "yaw_frequency": ("rad/s", "natural frequency of the yaw mode"),
    "yaw_damping": ("-", "damping ratio of the yaw mode"),
    "roll_frequency": ("rad/s", "natural frequency of the roll mode"),
    "roll_damping": ("-", "damping ratio of the roll mode"),
}


@dataclass(frozen=True)
class Quantity:
    """A value with its Cramer-Rao bound in `unit`, to first order; None where it cannot be computed."""

    value: float
    bound: float | None
    unit: str
    meaning: str


@dataclass(frozen=True, eq=False, repr=False)
class Handling(Shown):
    """Handling quantities {name in UNITS: value} at `speed` [m/s]; only those that exist for this rover.

    A mode with poles s1, s2 has the frequency sqrt(s1 s2) and the damping ratio -(s1 + s2)/(2 sqrt(s1 s2)),
    above 1 without oscillation; neither exists with an unstable real pole. tied: one cornering stiffness C
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
    def sentence(self) -> str:
        """A sentence: understeer or oversteer, and whether the data determine it."""
        k = self.quantities["understeer_gradient_deg_per_g"]
        kind = "understeers" if k.value > 0 else "oversteers" if k.value < 0 else "is neutral"
        speed = next(
            (
                f", {n.replace('_', ' ')} {self.quantities[n].value:.1f} m/s"
                for n in ("critical_speed", "characteristic_speed")
                if n in self.quantities
            ),
            "",
        )
        bound = "" if k.bound is None else f" ± {k.bound:.2g}"
        sentence = f"the rover {kind}: K_us {k.value:.2g}{bound} deg/g{speed}"
        if self.tied:
            return f"{sentence}; with one C for both axles the sign of K_us is that of b - a"
        if k.bound is not None and abs(k.value) < k.bound:
            return f"{sentence}; the bound exceeds the value, so the sign is not determined"
        return sentence

    def table(self) -> ShortTable:
        """Every quantity with its bound."""
        rows = tuple(
            (name, plain_number(q.value), plain_number(q.bound, 2), q.unit)
            for name, q in self.quantities.items()
        )
        title = f"handling of the {self.model} model at {self.speed:.2f} m/s"
        return ShortTable(title, ("quantity", "value", "bound", "unit"), rows, (self.sentence,))


def handling(fit: FitResult, speed: float | None = None) -> Handling:
    """Handling quantities of a fitted bicycle or roll-yaw model. speed [m/s]: default that of the fit.

    Bounds: sqrt(s^T P s), with the slopes s to the free parameters and their covariance P; fixed parameters
    count as exact. ValueError for a model without cornering stiffness.
    """
    structure, v = fit.structure, fit.speed if speed is None else speed
    if not has_handling(structure):
        raise ValueError(
            f"the {structure.name} model has no cornering stiffness, so it gives no handling quantities"
        )
    values = _quantities(structure, v)
    slopes = _slopes(structure, v, values)
    found = {n: Quantity(x, _bound(slopes[n], fit.covariance), *UNITS[n]) for n, x in values.items()}
    return Handling(structure.name, v, found, tied="C" in structure.values)


def has_handling(structure: ModelStructure) -> bool:
    """True for a model with axle distances, cornering stiffness, mass and yaw inertia."""
    known = structure.values
    return {"a", "b", "m", "Izz"} <= set(known) and ("C" in known or {"Cf", "Cr"} <= set(known))


def _quantities(structure: ModelStructure, speed: float) -> dict[str, float]:
    p = structure.values
    cf, cr = axle_stiffness(p)
    m, a, b = p["m"], p["a"], p["b"]
    base = a + b
    k = m / base * (b / cf - a / cr)
    turning = base + k * speed**2
    out = {
        "understeer_gradient": k,
        "understeer_gradient_deg_per_g": float(np.degrees(k)) * GRAVITY,
        "static_margin": (b * cr - a * cf) / (base * (cf + cr)),
        "yaw_rate_gain": speed / turning if turning else np.inf,
        "lateral_acceleration_gain": speed**2 / turning if turning else np.inf,
    }
    if k:
        name = "characteristic_speed" if k > 0 else "critical_speed"
        out[name] = float(np.sqrt(base / abs(k)))
    return {
        n: x for n in UNITS for found in (out | _modes(structure, speed),) if (x := found.get(n)) is not None
    }


def _modes(structure: ModelStructure, speed: float) -> dict[str, float]:
    """Natural frequency and damping of the yaw and the roll mode."""
    mat = structure.matrices(speed)
    poles, right = np.linalg.eig(np.linalg.solve(mat.m, mat.f))
    roll = [k for k, s in enumerate(structure.states) if s in ("p", "phi")]
    if len(roll) != 2 or len(poles) != 4:
        return _mode("yaw", poles) if len(poles) == 2 else {}
    share = (right * np.linalg.inv(right).T)[roll].sum(axis=0).real  # participation of the roll states
    pairs = [pair for pair in combinations(range(4), 2) if _closed(poles[list(pair)])]
    rolling = max(pairs, key=lambda pair: share[list(pair)].sum())
    yawing = [k for k in range(4) if k not in rolling]
    return _mode("yaw", poles[yawing]) | _mode("roll", poles[list(rolling)])


def _closed(pair: np.ndarray) -> bool:
    """True for two real poles or a conjugate pair."""
    return bool(abs(pair.sum().imag) <= 1e-9 * np.abs(pair).max())


def _mode(name: str, pair: np.ndarray) -> dict[str, float]:
    square = float(np.prod(pair).real)
    if square <= 0:
        return {}
    frequency = float(np.sqrt(square))
    return {f"{name}_frequency": frequency, f"{name}_damping": float(-pair.sum().real / (2 * frequency))}


def _slopes(structure: ModelStructure, speed: float, values: Mapping[str, float]) -> dict[str, np.ndarray]:
    """d quantity / d theta (n_free,) by central differences; nan where it exists on one side only."""
    columns: dict[str, list[float]] = {n: [] for n in values}
    for p in structure.free:
        step = STEP * (abs(p.value) or 1.0)
        up, down = (_quantities(structure.with_values({p.name: p.value + s}), speed) for s in (step, -step))
        for n, column in columns.items():
            column.append((up.get(n, np.nan) - down.get(n, np.nan)) / (2 * step))
    return {n: np.array(column) for n, column in columns.items()}


def _bound(slope: np.ndarray, covariance: np.ndarray | None) -> float | None:
    if covariance is None:
        return None
    variance = float(slope @ covariance @ slope)
    return float(np.sqrt(variance)) if np.isfinite(variance) and variance >= 0 else None


def warnings(
    found: Handling | None, runs: Sequence[Recording], friction: float | None = None
) -> tuple[Note, ...]:
    """Warnings of runs close to the critical speed or with a peak a_y close to the friction limit.

    found: gives the critical speed. friction: peak side force of the tyres over their load, 0.5 when None.
    a_y is V r, which holds neither the roll nor the vibration of an accelerometer's signal.
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
