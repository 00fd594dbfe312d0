"""The effects that a model can lack, and the model with one effect added or removed."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import exp, log, pi
from typing import TypeVar

import numpy as np
from numba import njit

from rover_sweep.data.geometry import GRAVITY, Geometry, Tolerances
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect, form_named, forms_of, library
from rover_sweep.diagnosis.effects.effect import DegreeOfFreedom, SpeedEffect
from rover_sweep.diagnosis.simulation.experiment import Experiment
from rover_sweep.identification.models import COLUMNS, ROWS, roll_yaw
from rover_sweep.identification.models import lumped as identified

# The nominal model of a baseline: its coordinates with their bounds and priors.
#
# Normal tolerances of every rover are coordinates of the nominal model: a lag and a delay up to 40 ms, Cf
# and Cr within 15 %, a steering scale within 3 % and others. The tolerance is the bound or the prior, so
# that it is never a finding. `speed_share`: of the speed's small changes (`Experiment.unsure`), what is
# motion and not an error of the estimate. Positive physical numbers have logarithmic coordinates.


@dataclass(frozen=True)
class Coordinate:
    """A number that the fit moves.

    low, high: bounds. scale: typical change. prior: standard deviation about `start`, None for no prior.
    unit: of the physical parameter.
    """

    name: str
    start: float
    low: float
    high: float
    scale: float
    prior: float | None = None
    parameter: str = ""
    """Physical parameter of a logarithmic coordinate, else ""."""
    unit: str = ""
    step: float = 0.02
    """Step of the difference quotients, in scales; 0 for a coordinate that a fit does not move."""


def coordinates(
    baseline: str, rover: Geometry, spread: Tolerances, slip: bool, roll: bool
) -> tuple[Coordinate, ...]:
    """The coordinates of a baseline ("kinematic", "bicycle", "roll-yaw").

    spread: normal tolerances. slip, roll: True if the model has them, by the baseline or by an effect.
    """
    s, length = spread, rover.wheelbase
    cg, imu_x, imu_z = s.cg * length, s.imu_x * length, s.imu_z * length
    out = [
        Coordinate("lag", 0.02, 0.0, s.lag, 0.01),
        Coordinate("lag_shape", 0.1, 0.0, 0.5, 0.1, 0.2),  # first order to a damping of .71
        Coordinate("delay", 0.015, -s.early, s.delay, 0.01),
        Coordinate("scale", 0.0, -3 * s.scale, 3 * s.scale, 0.02, s.scale),
        Coordinate("vscale", 0.0, -3 * s.speed, 3 * s.speed, 0.02, s.speed),
        Coordinate("speed_share", 0.7, 0.0, 1.0, 0.3),
        Coordinate("trim", 0.0, -s.trim, s.trim, 0.005),
        Coordinate("bias_ay", 0.0, -s.bias_ay, s.bias_ay, 0.1),
        Coordinate("imu_x", 0.0, -3 * imu_x, 3 * imu_x, 0.01, imu_x),
        Coordinate("imu_z", 0.0, -3 * imu_z, 3 * imu_z, 0.01, imu_z),
        Coordinate("ay_lag", 0.0, -3 * s.sensor_lag, 3 * s.sensor_lag, 0.005, s.sensor_lag),
        Coordinate("p_lag", 0.0, -s.sensor_lag, s.sensor_lag, 0.005, s.sensor_lag / 3),
        Coordinate("vy_lag", 0.003, 0.0, s.velocity_lag, 0.02),
        Coordinate("heading", 0.0, -3 * s.heading, 3 * s.heading, 0.01, s.heading),
        Coordinate("vy_gain", 0.0, -3 * s.velocity_gain, 3 * s.velocity_gain, 0.05, s.velocity_gain),
    ]
    if slip:
        stiffness = 3.0 * rover.mass * GRAVITY / 2
        inertia = rover.yaw_inertia or rover.mass * rover.a * rover.b
        wide = (0.4 * rover.wheelbase) ** 2  # half the track of most rovers
        out += [
            _log("C", stiffness, "N/rad"),
            _log("Izz", inertia, "kg m^2"),
            Coordinate("ln_ratio", 0.0, -s.ratio, s.ratio, 0.1),
            Coordinate("bend", s.bend, 0.0, 2 * s.bend, 0.3, 0.6 * s.bend),
            Coordinate("track", 0.0, 0.0, 3 * wide, 0.5 * wide, wide),
            Coordinate("da", 0.0, -3 * cg, 3 * cg, 0.01, cg),
        ]
    elif baseline == "kinematic":
        out.append(_log("L_eff", rover.wheelbase, "m"))
    if roll and rover.sprung_mass and rover.h and rover.roll_inertia:
        about = rover.roll_inertia + rover.sprung_mass * rover.h**2
        spring = about * (2 * pi * 3.5) ** 2
        out += [
            _log("k_phi", spring + rover.sprung_mass * GRAVITY * rover.h, "N m/rad"),
            _log("b_phi", 0.4 * about * 2 * pi * 3.5, "N m s/rad"),
            Coordinate("ln_h", 0.0, -3 * s.h, 3 * s.h, 0.05, s.h),
            Coordinate("ln_Ixx", 0.0, -3 * s.roll_inertia, 3 * s.roll_inertia, 0.1, s.roll_inertia),
        ]
    return tuple(out)


def has_roll(rover: Geometry) -> bool:
    """True if the vehicle file has the numbers of a model with roll."""
    return bool(rover.sprung_mass and rover.h and rover.roll_inertia)


def physical_numbers(x: Mapping[str, float], rover: Geometry) -> dict[str, float]:
    """{name as in `implausible`: SI value} of the coordinates of a fitted model."""
    out = {name: exp(x[f"ln_{name}"]) for name in ("Izz", "k_phi") if f"ln_{name}" in x}
    if "ln_C" in x:
        half = 0.5 * x.get("ln_ratio", 0.0)
        out |= {"Cf": exp(x["ln_C"] + half), "Cr": exp(x["ln_C"] - half)}
    if rover.roll_inertia and "ln_Ixx" in x:
        out["Ixx"] = rover.roll_inertia * exp(x["ln_Ixx"])
    if rover.h and "ln_h" in x:
        out["h"] = rover.h * exp(x["ln_h"])
    return out | {"steering_scale": 1.0 + x.get("scale", 0.0)}


def _log(name: str, start: float, unit: str) -> Coordinate:
    value = log(start)
    return Coordinate(f"ln_{name}", value, value - 3.0, value + 3.0, 0.1, None, name, unit)


# The lumped (Taylor series) model as a baseline, equation (19) of the paper, driven at the measured speed.
#
#     v' + V r = (Y_v v + Y_r r)/V + Y_p p + Y_phi phi + Y_delta d,   and the same for p' with L, r' with N
#
# Tyre forces are proportional to v/V and r/V. The derivatives by v and r are therefore multiplied by the
# speed here, which makes them valid at every speed; divided by it they are those of
# `identification.models.lumped`. v is V_y at the place of its measurement, and the position of the IMU is
# relative to that place. Without V_y the derivatives absorb the position. ISO axes, SI units.


def derivatives(rover: Geometry, roll: bool) -> tuple[Coordinate, ...]:
    """The coordinates "Y_v" to "N_delta", those by v and r times the speed; without roll none by p or phi.

    Each is bounded by ten times its first value, or its row's median if that is larger.
    """
    first = _first(rover, roll)
    rows = {row: {c: first[f"{row}_{c}"] for c in COLUMNS if f"{row}_{c}" in first} for row in ROWS}
    out = []
    for row, values in rows.items():
        middle = float(np.median(np.abs(list(values.values())))) if values else 0.0
        for column, value in values.items():
            reach = max(10.0 * abs(value), middle)
            out.append(Coordinate(f"{row}_{column}", value, -reach, reach, 0.03 * reach, 0.5 * reach))
    return tuple(out)


def _first(rover: Geometry, roll: bool) -> dict[str, float]:
    """First values from the rover's numbers by the roll-yaw model, or without roll by the bicycle model."""
    if roll:
        values = identified(rover, roll_yaw(rover), 1.0).values  # at 1 m/s they are those times the speed
        return {f"{row}_{c}": values[f"{row}_{c}"] for row in ROWS for c in COLUMNS}
    stiffness = 3.0 * rover.mass * GRAVITY / 2
    inertia = rover.yaw_inertia or rover.mass * rover.a * rover.b
    apart, about = rover.a - rover.b, rover.a**2 + rover.b**2
    side = {"v": -2.0, "r": -apart, "delta": 1.0}
    yaw = {"v": -apart, "r": -about, "delta": rover.a}
    return {f"Y_{c}": k * stiffness / rover.mass for c, k in side.items()} | {
        f"N_{c}": k * stiffness / inertia for c, k in yaw.items()
    }


def start_coordinates(parameters: Mapping[str, float], speed: float) -> dict[str, float]:
    """Coordinates from the derivatives of a lumped model that was identified at a speed [m/s]."""
    names = [(row, c) for row in ROWS for c in COLUMNS if f"{row}_{c}" in parameters]
    return {f"{row}_{c}": parameters[f"{row}_{c}"] * (speed if c in "vr" else 1.0) for row, c in names}


def motion(delta: Array, speed: Array, pushed: Array, x: Mapping[str, float], dt: float) -> dict[str, Array]:
    """Motion {name: (n,)} as `simulator.motion` gives it, ISO axes, SI units.

    delta (n,): road-wheel angle [rad]. speed (n,): V [m/s]. pushed (n,): added side force per mass [m/s^2].
    x: coordinates. dt: step [s].
    """
    table = np.array([[x.get(f"{row}_{c}", 0.0) for c in COLUMNS] for row in ROWS])
    y = _states(delta, speed, pushed, table, dt)
    names = ("v", "r", "phi", "p", "across", "r_dot", "p_dot")
    found = {name: y[:, k] for k, name in enumerate(names)}
    # v is V_y at the sensor already, while `simulator.sensed` moves "v" to the IMU
    found["v"] = found["v"] - x.get("imu_x", 0.0) * found["r"] + x.get("imu_z", 0.0) * found["p"]
    return found


@njit(cache=True, nogil=True, fastmath=True)
def _rates(x, out, d, speed, push, q):  # type: ignore[no-untyped-def]
    """Fill out (4,) with the slope of the state x (4,), v, r, phi, p; gives v' + V r."""
    u = (x[0] / speed, x[3], x[1] / speed, x[2], d)
    side, rolled, turned = push, 0.0, 0.0
    for k in range(5):
        side, rolled, turned = side + q[0, k] * u[k], rolled + q[1, k] * u[k], turned + q[2, k] * u[k]
    out[0], out[1], out[2], out[3] = side - speed * x[1], turned, x[3], rolled
    return side


@njit(cache=True, nogil=True, fastmath=True)
def _states(steer, speed, push, q, dt):  # type: ignore[no-untyped-def]
    """Motion (n, 7) in the columns v, r, phi, p, v' + V r, r', p'; RK4 of step dt. q (3, 5): derivatives."""
    n = steer.size
    y = np.zeros((n, 7))
    x, trial, slope, total = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4)
    for k in range(n):
        end = min(k + 1, n - 1)
        total[:] = x
        for stage in range(4):
            later = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)  # share of the step
            kept, weight = 1.0 - later, dt / 6.0 if stage in (0, 3) else dt / 3.0
            for i in range(4):
                trial[i] = x[i] + later * dt * slope[i]
            d, v = kept * steer[k] + later * steer[end], kept * speed[k] + later * speed[end]
            across = _rates(trial, slope, d, v, kept * push[k] + later * push[end], q)
            if stage == 0:
                y[k, :4], y[k, 4], y[k, 5], y[k, 6] = x, across, slope[1], slope[3]
            for i in range(4):
                total[i] += weight * slope[i]
        for i in range(4):
            x[i] = total[i] if abs(total[i]) < 1e3 else 0.0  # an unstable trial of the fit
    return y


SAME_SPEED = 0.12  # relative
Kind = TypeVar("Kind", bound=Effect)
DEGREES_OF_FREEDOM = frozenset(e.id for e in library().values() if isinstance(e, DegreeOfFreedom))


@dataclass(frozen=True)
class Model:
    """A baseline with effects, to be simulated and fitted.

    baseline: "kinematic", "bicycle", "roll-yaw" or "lumped". spread: normal tolerances of a rover. effects:
    names of laws. happened_in: name of the run with a surface change, happened_order: its place in time.
    two_clocks: steering and motion have two clocks. given: ids of effects that belong to the baseline: an
    inference does not test them. unnamed: laws without a name, simulated in addition.
    """

    baseline: str
    rover: Geometry
    spread: Tolerances
    effects: tuple[str, ...] = ()
    happened_in: str = ""
    two_clocks: bool = False
    happened_order: int = 0
    given: frozenset[str] = frozenset()
    unnamed: tuple[Effect, ...] = ()

    @property
    def slip(self) -> bool:
        """True if the tyres slip."""
        return self.baseline != "kinematic" or "tyre_slip" in self.effects

    @property
    def roll(self) -> bool:
        """True if the body rolls."""
        if self.baseline == "lumped":
            return has_roll(self.rover)
        return self.baseline == "roll-yaw" or "roll_dof" in self.effects

    @property
    def lumped(self) -> bool:
        """True if derivatives replace tyres and springs."""
        return self.baseline == "lumped"

    @cached_property
    def acting(self) -> tuple[Effect, ...]:
        """The laws that the simulation adds to the baseline, those without a name last."""
        found = (form_named(e) for e in self.effects if e not in DEGREES_OF_FREEDOM)
        return (*found, *self.unnamed)

    def of(self, kind: type[Kind]) -> tuple[Kind, ...]:
        """The acting laws of a kind."""
        return tuple(e for e in self.acting if isinstance(e, kind))

    @cached_property
    def free(self) -> tuple[Coordinate, ...]:
        """The fitted coordinates: nominal ones (without prior if an effect releases them) and added ones.

        A coordinate that an effect releases to one value only is held there.
        """
        parts = (False, False) if self.lumped else (self.slip, self.roll)
        nominal = coordinates(self.baseline, self.rover, self.spread, *parts)
        if self.lumped:  # Y_delta, L_delta and N_delta include the scale of the steering
            steering = (c for c in nominal if c.name != "scale")
            nominal = (*steering, *derivatives(self.rover, self.roll))
        released: dict[str, tuple[float, float]] = {}
        for law in map(form_named, self.effects):
            released |= law.releases
            if law.id == "clock_offset" and not self.two_clocks:
                # with one clock only a response before the command is an offset
                released["delay"] = law.releases["delay"][0], self.spread.delay
        out = []
        for c in nominal:
            if c.name in released:
                low, high = released[c.name]
                c = replace(c, low=low, high=high, prior=None, step=c.step if high > low else 0.0)
            out.append(c)
        for name in self.effects:
            out += added_coordinates(self.law(name))
        return tuple(out)

    @property
    def start(self) -> dict[str, float]:
        """{coordinate: value} to begin a fit from."""
        return {c.name: c.start for c in self.free}

    def law(self, name: str) -> Effect:
        """A law by its name, with the sizes that it has on this rover."""
        return form_named(name).sized(self._growth)

    def laws(self, effect: str) -> tuple[Effect, ...]:
        """All laws of the effect with this id, with the sizes that they have on this rover."""
        return tuple(law.sized(self._growth) for law in forms_of(effect))

    @property
    def _growth(self) -> Mapping[str, float]:
        """Size of this rover over 0.5 m and 3 N m of ms g h, for which sizes were set."""
        moment = (self.rover.sprung_mass or 0.0) * GRAVITY * (self.rover.h or 0.0)
        return {"wheelbase": max(self.rover.wheelbase / 0.5, 1.0), "roll moment": max(moment / 3.0, 1.0)}

    def with_effect(self, effect: str, run: str = "", order: int = 0) -> Model:
        """This model plus a law, by name. run, order: the run in which it happens."""
        more = replace(self, effects=(*self.effects, effect))
        return replace(more, happened_in=run, happened_order=order) if run else more

    def without(self, effect: str) -> Model:
        """This model with an effect removed, whatever its form; effect: its id."""
        return replace(self, effects=tuple(e for e in self.effects if form_named(e).id != effect))

    @property
    def laws_and_run(self) -> tuple[str, ...]:
        """Names of the laws and the run in which one begins; identifies a rover's model."""
        return (*self.effects, self.happened_in)

    @property
    def ids(self) -> tuple[str, ...]:
        """The ids of the effects, without their forms."""
        return tuple(form_named(e).id for e in self.effects)


def added_coordinates(effect: Effect) -> list[Coordinate]:
    """The coordinates that an effect adds, without those that it releases."""
    return [
        Coordinate(effect.key(p.name), 0.0, p.low, p.high, p.size) for p in effect.parameters if not p.nominal
    ]


def possible(
    model: Model, runs: Sequence[Experiment], only: Collection[str] = (), without: Collection[str] = ()
) -> tuple[list[Effect], dict[str, str]]:
    """(further effects that these runs can show, {effect: why they cannot show it}).

    Effects on the speed are left out: the measured speed drives the model, and `speed_loss` tests them.
    """
    found, unseen = [], {}
    for effect in (model.law(name) for name in library()):
        if isinstance(effect, SpeedEffect) or effect.id in model.ids or effect.id in without:
            continue
        if only and effect.id not in only:
            continue
        if is_included(effect, model):
            continue
        why = why_unseen(effect, model, runs)
        if why:
            unseen[effect.id] = why
        else:
            found.append(effect)
    return found, unseen


def is_included(effect: Effect, model: Model) -> bool:
    """True for a degree of freedom that the baseline has."""
    return effect.id in DEGREES_OF_FREEDOM and model.baseline not in effect.baselines


def why_unseen(effect: Effect, model: Model, runs: Sequence[Experiment]) -> str:
    """Why an effect cannot show in these runs with this model, "" if it can."""
    recorded = {c for run in runs for c in run.measured}
    has = "roll-yaw" if model.slip and model.roll else "bicycle" if model.slip else "kinematic"
    has = "lumped" if model.lumped else has
    if effect.id not in DEGREES_OF_FREEDOM and has not in effect.baselines:
        return f"acts in {' or '.join(effect.baselines)} models, the baseline is {has}"
    if not recorded & set(effect.channels):
        return f"none of {', '.join(effect.channels)} was recorded"
    if effect.id == "imu_tilt" and model.lumped:
        return "the lumped derivatives include the mixing of p and r, and bias_ay the constant"
    if effect.id == "imu_offset" and model.lumped and "vy" not in recorded:
        return "no V_y was recorded, so the lumped derivatives include it"
    if effect.id == "cross_slope" and not any(run.has_heading for run in runs):
        return "no heading was recorded"
    if effect.id == "roll_dof" and not has_roll(model.rover):
        return "the vehicle file has no sprung mass, height or roll inertia"
    return ""


def same_speed(a: Experiment, b: Experiment) -> bool:
    """True for runs whose mean speeds are within 12 %."""
    return alike_speeds(*sorted((a.mean_speed, b.mean_speed)))


def alike_speeds(low: float, high: float) -> bool:
    """True for two speeds within 12 %."""
    return high < (1 + SAME_SPEED) * low
