"""An effect added to a model: its linear prediction (a score test), and the sizes from which it matters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp

import numpy as np
from scipy.linalg import qr

from rover_sweep.data.geometry import GRAVITY, Tolerances
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect, EffectParameter
from rover_sweep.diagnosis.problem.least_squares import COARSE, Fitted, fit, prior_information
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.result import Mismatch
from rover_sweep.diagnosis.simulation.candidates import (
    DEGREES_OF_FREEDOM,
    Coordinate,
    Model,
    added_coordinates,
)

INSTANTS = 7  # at which a change of ground is tried in each run
PER_PARAMETER = (
    6.0 * COARSE
)  # gain that one more parameter of a form must bring: twice -ln of its Occam factor
NO_GAIN = 2.0  # predicted gain below which an effect explains nothing


@dataclass(frozen=True, eq=False)
class Tangent:
    """Orthonormal directions in which a fitted model can move its rows.

    q (rows + k, k) for k coordinates that are inside their bounds: below the `rows` of the data is one
    row for the prior of each coordinate, so that a prior limits the movement.
    """

    q: Array
    rows: int

    def outside(self, residual: Array) -> Array:
        """The part (rows + k, ...) of residuals (rows,) or (rows, m) that the model cannot reach."""
        full = np.zeros((self.q.shape[0], *residual.shape[1:]))
        full[: self.rows] = residual
        return full - self.q @ (self.q.T @ full)


def tangent(fitted: Fitted) -> Tangent:
    """The tangent of a fit at its coordinates."""
    loose = np.flatnonzero(fitted.inside)
    columns = fitted.jacobian[:, loose]
    stacked = np.vstack((columns, np.diag(np.sqrt(prior_information(fitted.free)[loose]))))
    q = qr(stacked, mode="economic")[0]
    return Tangent(q, fitted.rows.size)


def score(signature: Array, residual: Array) -> tuple[float, float]:
    """(predicted gain, amount) of a signature (n,) in a residual (n,), both outside of the model's reach.

    (0.0, 0.0) if the signature vanishes.
    """
    power = float(signature @ signature)
    amount = float(signature @ residual) / power if power >= 1e-6 else 0.0
    return amount * amount * power, amount


def linear_prediction(
    problem: Problem, base: Fitted, space: Tangent, model: Model, effect: Effect
) -> tuple[float, dict[str, float]] | None:
    """(gain predicted by the score test, {coordinate: start value of a fit}); None: no gain.

    space: tangent of the base. The best of several sizes, or instants, counts.
    """
    starts = _starts(effect, problem, base, model)
    models = problem.models(model, [{**base.x, **s} for s in starts])
    now = problem.measured - base.rows
    outside = space.outside(base.rows)
    best: tuple[float, float, dict[str, float]] | None = None
    for start, rows in zip(starts, models, strict=True):
        predicted, amount = score(space.outside(rows - now), outside)
        if (amount > 0 or effect.signed) and predicted > (best[0] if best else 0.0):
            best = predicted, amount, start
    if together := _together(effect, base, space, starts, [rows - now for rows in models]):
        best = max(best or together, together, key=lambda one: one[0])
    if best is None or (best[0] < NO_GAIN and added_coordinates(effect)):
        return None
    predicted, amount, start = best
    factor = float(np.sign(amount) * np.clip(abs(amount), 0.5, 2.0))
    return predicted, {
        k: v if k.endswith(".t") else base.x.get(k, 0.0) + (v - base.x.get(k, 0.0)) * factor
        for k, v in start.items()
    }


def _together(
    effect: Effect, base: Fitted, space: Tangent, starts: Sequence[Mapping[str, float]], rows: Sequence[Array]
) -> tuple[float, float, dict[str, float]] | None:
    """(predicted gain, 1.0, start) of all parameters at once, None for an effect with one or an instant.

    rows: what each start adds. For each parameter the smallest change is used: the most linear one.
    """
    names = [effect.coordinate_name(p) for p in effect.parameters]
    moved = [{n: s[n] - base.x.get(n, 0.0) for n in names} for s in starts] if not effect.in_one_run else []
    first: dict[str, int] = {}
    for k, (move, added) in enumerate(zip(moved, rows, strict=False)):
        for name in names:
            if move[name] and float(added @ added) > 0.0:
                first.setdefault(name, k)
    if len(first) < 2 or not effect.signed:
        return None
    columns = space.outside(np.column_stack([rows[k] for k in first.values()]))
    amounts, *_ = np.linalg.lstsq(columns, space.outside(base.rows))
    gain = float(np.sum((columns @ amounts) ** 2))
    change = {n: float(a) * moved[k][n] for (n, k), a in zip(first.items(), amounts, strict=True)}
    return gain, 1.0, {n: base.x.get(n, 0.0) + change.get(n, 0.0) for n in names}


def _starts(effect: Effect, problem: Problem, base: Fitted, model: Model) -> list[dict[str, float]]:
    if effect.in_one_run and len(effect.parameters) > 1:
        run = next(r for r in problem.runs if r.name == model.happened_in)
        instants = np.linspace(0.12, 0.88, INSTANTS) * run.t[-1]
        size = effect.parameters[0].size
        return [{effect.key("ratio"): size, effect.key("t"): float(t)} for t in instants]
    sizes = {effect.coordinate_name(p): p.size * p.per for p in effect.parameters}
    limits = {c.name: (c.low, c.high) for c in model.free}
    out = []
    for one, size in sizes.items():
        low, high = limits[one]
        now = base.x.get(one, 0.0)
        # a law that locks or lets slip shows nothing of its kind at a small size
        ends = dict.fromkeys(float(np.clip(now + f * size, low, high)) for f in (0.25, 1.0, 4.0, 16.0))
        out += [{n: (end if n == one else base.x.get(n, 0.0)) for n in sizes} for end in ends]
    return out


@dataclass(frozen=True, eq=False)
class Screened:
    """An effect with its predicted gain, the model with it, and the coordinates to begin a fit from.

    effect: the id; the form is in the model.
    """

    effect: str
    model: Model
    predicted: float
    start: Mapping[str, float]


def screen(problem: Problem, base: Fitted, space: Tangent, model: Model, effect: Effect) -> Screened | None:
    """The linear prediction of an effect: its best form, in the run that shows it best; None: no gain."""
    found = screened_forms(problem, base, space, model, effect)
    return max(found, key=lambda x: x.predicted - PER_PARAMETER * len(x.start), default=None)


def screened_forms(
    problem: Problem, base: Fitted, space: Tangent, model: Model, effect: Effect
) -> list[Screened]:
    """The linear predictions of all forms of an effect that promise a gain; of an event, in each run."""
    if effect.id in DEGREES_OF_FREEDOM:
        return [Screened(effect.id, model.with_effect(effect.id), np.inf, {})]
    extended = [
        (law, model.with_effect(law.name, run.name if law.in_one_run else "", run.order))
        for law in model.laws(effect.id)
        for run in (problem.runs if law.in_one_run else problem.runs[:1])
    ]
    found = [(m, linear_prediction(problem, base, space, m, law)) for law, m in extended]
    return [Screened(effect.id, m, *one) for m, one in found if one is not None]


# Normal tolerances of a rover: the material size of an effect, and nominal numbers at their ends.


LAGS = ("servo_lag", "transport_delay")
EARLIER = 0.008  # s, least time that these runs show: the motion before its command, a servo's swinging
COUNTS = 25.0  # drop of the cost from which the end of a tolerance is reported
MEASURED = {  # number of the nominal model: (in words, its factor, its unit)
    "delay": ("the steering's delay", 1e3, "ms"),
    "lag": ("the servo's lag", 1e3, "ms"),
    "scale": ("the steering scale (rad_per_us)", 100.0, "%"),
    "vscale": ("the scale of the speed", 100.0, "%"),
    "trim": ("the steering's trim", 1e3, "mrad"),
    "bias_ay": ("the accelerometer's bias", 1.0, "m/s^2"),
    "imu_x": ("the IMU's place along the rover", 1e3, "mm"),
    "imu_z": ("the IMU's height", 1e3, "mm"),
    "vy_lag": ("the lag of the lateral velocity", 1e3, "ms"),
    "ln_ratio": ("the ratio of front to rear cornering stiffness", 100.0, "%"),
    "da": ("the place of the centre of gravity", 1e3, "mm"),
    "ln_h": ("the height of the sprung mass", 100.0, "%"),
    "ln_Ixx": ("the roll inertia", 100.0, "%"),
}


def material_sizes(effect: Effect, spread: Tolerances, wheelbase: float) -> dict[str, float]:
    """{parameter: coordinate to exceed}: the effect's own material size, or a tolerance of the rover.

    wheelbase: of the rover, m.
    """
    moved: Mapping[str, Mapping[str, float]] = {
        "front_rear_stiffness": {"ratio": spread.ratio},
        "imu_offset": {"x": 2.0 * spread.imu_x * wheelbase, "z": 2.0 * spread.imu_z * wheelbase},
        "imu_tilt": {"roll": spread.bias_ay / GRAVITY},
        "steering_trim": {"u0": spread.trim},
        "velocity_lag": {"T": spread.velocity_lag},
    }
    return {
        name: size for name, size in {**effect.thresholds, **moved.get(effect.id, {})}.items() if size > 0
    }


def least_size(effect: Effect, parameter: EffectParameter, model: Model, x: Mapping[str, float]) -> float:
    """Magnitude of a parameter's coordinate from which its effect matters; 0: every size does.

    x: {coordinate: value}. Lag and delay matter only if together they exceed the normal tolerance.
    """
    if effect.id in LAGS:
        return model.spread.together - x["delay" if effect.id == "servo_lag" else "lag"]
    if effect.id == "clock_offset" and not model.two_clocks:
        return EARLIER
    return material_sizes(effect, model.spread, model.rover.wheelbase).get(parameter.name, 0.0)


def is_material(effect: str, model: Model, x: Mapping[str, float]) -> bool:
    """False if an effect of a fitted model is below its material size, or beyond 80 % of its bound.

    effect: its id. x: {coordinate: value}.
    """
    law = next(f for f in map(model.law, model.effects) if f.id == effect)
    limits = {c.name: max(abs(c.low), abs(c.high)) for c in added_coordinates(law)}
    if any(abs(x[name]) > 0.8 * limit for name, limit in limits.items() if not name.endswith(".t")):
        return False
    if law.name == "servo_lag/second order" and x["lag_shape"] > 1.0 and x["lag"] > EARLIER:
        return True  # it swings more than usual, with a damping ratio below 0.5
    if effect in LAGS:
        return x["lag"] + x["delay"] > model.spread.together
    if effect == "clock_offset" and not model.two_clocks:
        return x["delay"] < -EARLIER
    return law.exceeds(x, material_sizes(law, model.spread, model.rover.wheelbase))


def at_the_end(problem: Problem, fitted: Fitted) -> dict[str, str]:
    """{number: sentence} of nominal numbers at a limit of their tolerance that fit better outside.

    Outside: by a tenth of the tolerance or more. Delay and lag come first.
    """
    ends = {c.name: c for c, inside in zip(fitted.free, fitted.inside, strict=True) if not inside}
    out = {}
    for name, (words, factor, unit) in MEASURED.items():
        c = ends.get(name)
        if c is None or (c.low == 0.0 and fitted.x[name] <= c.low):
            continue
        if name == "bias_ay" and not any("ay" in run.measured for run in problem.runs):
            continue
        freed, room = _freed(problem, fitted, c), 0.1 * (c.high - c.low)
        at_high = fitted.x[name] > 0.5 * (c.low + c.high)
        beyond = freed.x[name] >= c.high + room if at_high else freed.x[name] <= c.low - room
        if fitted.cost - freed.cost > COUNTS and beyond:
            now, better = (
                exp(v) - 1.0 if name.startswith("ln_") else v for v in (fitted.x[name], freed.x[name])
            )
            digits = "+.0f" if unit == "%" else ".3g"
            out[name] = (
                f"{words} is at the limit of its tolerance ({factor * now:{digits}} {unit}) and fits "
                f"better at {factor * better:{digits}} {unit}: measure it"
            )
    return out


MANY = 3  # numbers outside their tolerances, from which the model is wrong and not the file


def many_at_the_end(ends: Mapping[str, str], places: Sequence[Mismatch]) -> tuple[str, ...]:
    """A remark if three or more numbers fit better outside their tolerances, else ().

    places: where the fitted model and the runs differ, the largest first.
    """
    if len(ends) < MANY:
        return ()
    names = ", ".join(MEASURED[name][0] for name in ends)
    rest = f". Its largest residual: {places[0].sentence}" if places else ""
    return (
        f"the model is wrong: {len(ends)} numbers fit better outside their normal tolerances ({names}). "
        f"Another effect is missing, or runs and vehicle file are of two rovers{rest}",
    )


def _freed(problem: Problem, fitted: Fitted, c: Coordinate) -> Fitted:
    """The fit with this coordinate's bounds five times as far from its start value."""
    low = c.low if c.low == 0.0 else c.start - 5.0 * (c.start - c.low)
    wide = replace(c, low=low, high=c.start + 5.0 * (c.high - c.start), prior=None)
    free = tuple(wide if one.name == c.name else one for one in fitted.free)
    return fit(problem, fitted.model, fitted.x, free, known=fitted, roughly=True)
