"""The rovers of the drawn logs: the bench's engines and the plant of `sitl`, and their true numbers.

The truth is measured and not computed: each rover is driven without noise through steps of the steering, and
its numbers are what these steps show. So no equation of the identification is used, and an engine's tyres and
steering count as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from numpy.random import Generator

from sitl.plant.plant import Plant
from sitl.plant.variant import PlantParameters, load_variant
from tests.engines.engine import MODULES, Array, Engine, EngineRover, Signals, drawn_rover, engine
from tests.foreign.plant import DT, SURFACE
from tests.foreign.recorded import mounted
from tests.foreign.rover import SIZES

SITL = "sitl"
SHARES = {"foreign": 0.45, SITL: 0.2, "commonroad": 0.15, "slipx": 0.1, "mujoco": 0.1}
"""How often each engine is drawn; exudyn takes minutes for ten minutes of driving."""

LIMIT_US = 400.0  # the servo's ends, from 1500 us
SETTLE, HELD = 9.0, 5.0  # s of a step of the truth: before it, and after it
GENTLE, PROBED = 0.15, (0.4, 0.7, 1.0)  # share of the large steering; speeds, in shares of the rover's
SLOW = 0.3  # share of the rover's speed in its tightest turn
FRICTION = 1.0  # of the sitl plant, whose tyres bend


@dataclass(frozen=True)
class Truth:
    """What a right answer says of a rover whose steering is recorded in us.

    curvature: of the path at walking pace, 1/m per 100 us; understeer: K_us over the wheelbase, s^2/m^2;
    straight: us; direction: the way that a larger output turns, 1 left, -1 right; delay: s in which nothing
    moves; lag: s by which the turn is later, at each of `speeds` [m/s]; servo: s of it by which the wheels
    are late; bend: how much less it turns at 3 m/s^2; rad_per_us, wheelbase [m] of the linkage; tightest:
    radius [m] at the servo's farther end at walking pace; large angles turn by more than in proportion.
    """

    curvature: float
    understeer: float
    straight: float
    direction: int
    delay: float
    speeds: tuple[float, ...]
    lag: tuple[float, ...]
    servo: float
    bend: float
    rad_per_us: float
    wheelbase: float
    tightest: float | None = None

    def curvature_at(self, speed: float) -> float:
        """At a speed [m/s], 1/m per 100 us."""
        return self.curvature / (1 + self.understeer * speed**2)

    def lag_at(self, speed: float) -> float:
        """At a speed [m/s], s; constant beyond the probed speeds."""
        return float(np.interp(speed, self.speeds, self.lag))


def drawn_engine(rng: Generator, allowed: tuple[str, ...]) -> tuple[str, EngineRover]:
    """(name of an engine, rover of it); one whose package is missing is replaced by `foreign`."""
    shares = np.array([SHARES[name] for name in allowed])
    name = str(rng.choice(allowed, p=shares / shares.sum()))
    if name != SITL:
        try:
            engine(name)
        except ImportError:
            name = "foreign"
    rover = drawn_rover(rng, SIZES[int(rng.integers(len(SIZES)))])
    return name, replace(rover, instruments=replace(rover.instruments, loop_hz=50.0, ekf_hz=50.0))


def physics(name: str) -> Engine:
    """The engine of this name; that of `sitl` has no laws."""
    if name == SITL:
        return Engine(SITL, SIZES, _of_sitl, (), (), {})
    return engine(name)


assert set(SHARES) - {SITL} < set(MODULES)


# ---- The plant of `sitl`, which was written for the simulated autopilot, with the numbers of a drawn rover.

STEP_S = 0.0025  # s
FULL_SPEED = 6.0  # m/s of its throttle, at 400 us
NEUTRAL = 1500.0


def plant_parameters(rover: EngineRover) -> PlantParameters:
    """The rover as the plant has it. Its delay is left out: the command comes after it."""
    n, i, s = rover.numbers, rover.instruments, rover.surroundings
    share = 1 / max(rover.speed, 0.5)
    return replace(
        load_variant("nominal"),
        mass=n.m,
        sprung_mass=n.ms,
        cg_to_front_axle=n.a,
        cg_to_rear_axle=n.b,
        cg_height_above_roll_centre=n.h,
        yaw_inertia=n.Izz,
        roll_inertia=n.Ixx,
        roll_stiffness=n.kphi,
        roll_damping=n.bphi,
        front_cornering_stiffness=n.Cf,
        rear_cornering_stiffness=n.Cr,
        friction=FRICTION,
        steering_trim_us=NEUTRAL,
        rad_per_us=rover.rad_per_us,
        steering_limit=0.6,
        servo_lag=1 / n.gain,
        servo_delay=0.0,
        servo_rate_limit=n.rate,
        speed_per_us=FULL_SPEED / LIMIT_US,
        throttle_deadband_us=0.0,
        speed_lag=n.tau_drive,
        drive_force_limit=n.most_drive * n.m,
        rolling_resistance=n.rolling,
        road_force=s.road[0] * n.m * share,
        road_yaw_moment=s.road[1] * n.Izz * share,
        road_roll_moment=s.road[2] * n.Ixx * share,
        imu_position=(i.imu_x, 0.0, n.h - i.imu_z),
    )


def _of_sitl(rover: EngineRover, command: Array, wanted: Array, around: Array, heading: float) -> Signals:
    """The plant's road is its own, and there is none where `around` has none."""
    parameters = plant_parameters(rover)
    if not np.any(around[:, 1:]):
        parameters = replace(parameters, road_force=0.0, road_yaw_moment=0.0, road_roll_moment=0.0)
    plant = Plant(parameters, seed=int(1e6 * abs(command[-1])) + command.size)
    plant.state.psi = heading
    steps = ceil(command.size * DT / STEP_S)
    at = np.minimum((np.arange(steps) * STEP_S / DT).astype(int), command.size - 1)
    steering = (NEUTRAL - command[at] / rover.rad_per_us).tolist()
    # the resistance of rolling takes some of the speed that the drive tends to
    more = rover.numbers.rolling * 9.81 * rover.numbers.tau_drive
    asked = wanted[at]
    throttle = (NEUTRAL + (asked + more * np.sign(asked)) / FULL_SPEED * LIMIT_US).tolist()
    out = np.empty((steps, 9))
    state = plant.state
    for k in range(steps):
        plant.step(steering[k], throttle[k], STEP_S)
        out[k] = state.vx, state.vy, state.r, state.phi, state.p, state.psi, state.ax, state.ay, state.az
    fine, coarse = np.arange(command.size) * DT, np.arange(1, steps + 1) * STEP_S
    u, v, r, phi, p, psi, ax, ay, az = (np.interp(fine, coarse, column) for column in out.T)
    i = rover.instruments
    return {
        **mounted(r * np.cos(phi), p, (ax, ay, az), i),
        "vy": v + r * i.imu_x - i.imu_z * np.cos(phi) * p,
        "speed": u,
        "phi": phi,
        "psi": psi,
    }


# ---- The truth, by steps of the steering without noise.


def true_numbers(name: str, rover: EngineRover, mirrored: bool) -> Truth:
    """mirrored: the servo is mounted the other way round, so that a larger output turns left."""
    used, large = physics(name), rover.amplitude / rover.rad_per_us
    gentle = [_step(used, rover, GENTLE * large, share * rover.speed) for share in PROBED]
    hard = _step(used, rover, large, rover.speed)
    speeds, curvatures, lags = (np.array(column) for column in zip(*gentle, strict=True))
    slope, at_rest = np.polyfit(speeds**2, 1 / curvatures, 1)
    understeer = float(slope / at_rest)
    there = 1 / (at_rest * (1 + understeer * hard[0] ** 2))
    felt = hard[1] / 100 * large * hard[0] ** 2
    bend = (there / hard[1] - 1) * (3.0 / felt) ** 2
    straight = rover.trim_us
    far = LIMIT_US + abs(straight - NEUTRAL)
    tightest = 100 / (far * _step(used, rover, far, SLOW * rover.speed)[1])
    return Truth(
        float(1 / at_rest),
        understeer,
        3000.0 - straight if mirrored else straight,
        1 if mirrored else -1,
        rover.delay,
        tuple(speeds.tolist()),
        tuple(lags.tolist()),
        1 / rover.numbers.gain,
        float(bend),
        rover.rad_per_us,
        rover.numbers.a + rover.numbers.b,
        float(tightest),
    )


def _step(used: Engine, rover: EngineRover, us: float, speed: float) -> tuple[float, float, float]:
    """(speed [m/s], curvature [1/m per 100 us], lag [s]) of a step of the steering by `us` to the left.

    The lag is the area between the step and the answer: by how much the answer to slow steering is late.
    """
    quiet = replace(rover.instruments, tilt=(0.0, 0.0, 0.0), imu_x=0.0)
    steps, begin = round((SETTLE + HELD) / DT), round(SETTLE / DT)
    command = np.zeros(steps)
    command[begin:] = us * rover.rad_per_us
    around = np.zeros((steps, 7))
    around[:, SURFACE] = 1.0
    found = used.signals(
        replace(rover, instruments=quiet), command, np.full(steps, speed), around, heading=0.0
    )
    turned = found["r"] / np.maximum(np.cos(found["phi"]), 0.5) / np.maximum(found["speed"], 0.05)
    answer = turned[begin:] - float(np.mean(turned[begin - 500 : begin]))
    end = float(np.mean(answer[-1000:]))
    return (float(np.mean(found["speed"][-1000:])), 100 * end / us, float(np.sum(1 - answer / end) * DT))
