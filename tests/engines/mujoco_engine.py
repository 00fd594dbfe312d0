"""MuJoCo as an engine: the loop of a run, compiled around the library's own mj_step.

The steering up to the wheels is `tests.foreign.plant`; all that follows are bodies, joints and contacts. A
tyre's side force goes with its slip angle, therefore the damping of its contact is divided by the speed.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from math import cos, sin, sqrt
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np
from numba import njit

from tests.engines.engine import Array, Engine, EngineRover, Signals
from tests.engines.shared_laws import (
    AROUND,
    OWN_PARTS,
    PATH,
    SENSING,
    chassis_inertia,
    outside_laws,
    own_numbers,
    vehicle_laws,
)
from tests.foreign.grade import PLACES as FOREIGN_PLACES
from tests.foreign.laws import Extras, Law, coupling, damping, friction_limit, peak_ay, valued
from tests.foreign.plant import (
    DT,
    GRAVITY,
    ROAD_ROLL,
    ROAD_Y,
    ROAD_YAW,
    STEERING_STATES,
    SURFACE,
    WIND_X,
    WIND_Y,
    Numbers,
    steering_step,
)
from tests.foreign.rover import SIZES, Rover

STEP = 1e-3  # s
IMPEDANCE = 0.1  # of the contacts: a soft constraint adds a mass of only a few per cent of the wheel's
TYRE_OVER_LEG = 20.0  # vertical stiffness
STEERING_W = 400.0  # rad/s, of the position servo at each front wheel
HUB = 0.4  # share of the unsprung mass that does not roll
ROTOR = 0.03  # of the rover's mass: motor and gear at the rolling radius of each wheel
MU = 1.2
# front or rear, share of the track to the left
CORNERS = ((1.0, 0.5), (1.0, -0.5), (-1.0, 0.5), (-1.0, -0.5))


@dataclass(frozen=True)
class Build:
    """Model, data after settling, and the resistance R of a contact row (1/kg) for each wheel."""

    model: mujoco.MjModel
    data: mujoco.MjData
    resistance: tuple[float, float, float, float]


def built(rover: EngineRover, heading: float) -> Build:
    """The rover at rest. Contacts: friction rows of the solver give F = -b v / R, b = -solreffriction[1] / d
    (MuJoCo documentation, Computation, "Solver parameters"), so R turns a tyre's stiffness into b."""
    model = mujoco.MjModel.from_xml_string(xml(rover, heading))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    if data.ncon != 4:
        raise RuntimeError(f"{data.ncon} of 4 wheels touch the ground")
    found = [0.0] * 4
    for k in range(4):
        contact = data.contact[k]
        found[_wheel(model, contact)] = float(data.efc_R[contact.efc_address + 1])
        pair, row = _wheel(model, contact), float(data.efc_R[contact.efc_address])
        vertical = TYRE_OVER_LEG * spring(rover)
        mass = (rover.numbers.m - rover.numbers.ms) / 4
        model.pair_solref[pair] = (
            -vertical * row * IMPEDANCE**2,
            -2 * 0.3 * sqrt(vertical * mass) * row * IMPEDANCE,
        )
    for _ in range(400):
        mujoco.mj_step(model, data)
    return Build(model, data, (found[0], found[1], found[2], found[3]))


def _wheel(model: mujoco.MjModel, contact: object) -> int:
    geoms = (contact.geom1, contact.geom2)  # type: ignore[attr-defined]
    return next(k for k in range(4) if model.geom(f"tyre{k}").id in geoms)


def spring(rover: EngineRover) -> float:
    """Of a leg, N/m: four legs at half the track give the roll stiffness kphi."""
    return rover.numbers.kphi / rover.numbers.track**2


def xml(rover: EngineRover, heading: float) -> str:
    """The model's description; SI units."""
    n, own = rover.numbers, rover.own
    loose = own.get("pendulum", 0.0) + own.get("sliding", 0.0)
    ahead, ixx, iyy, izz = chassis_inertia(rover)
    iyy = min(max(iyy, izz - 0.95 * n.Ixx), 0.95 * (izz + n.Ixx))
    fall = GRAVITY * sin(n.slope)
    gravity = (fall * cos(n.slope_heading), fall * sin(n.slope_heading), -GRAVITY * cos(n.slope))
    mass = n.ms * (1 - loose)
    sunk = n.m * GRAVITY / 4 / (TYRE_OVER_LEG * spring(rover))  # into the ground, at rest
    legs = "".join(_leg(rover, k, mass + loose * n.ms, ahead) for k in range(4))
    pairs = "".join(
        f'<pair geom1="ground" geom2="tyre{k}" condim="3" friction="{_mu(rover)} {_mu(rover)} 0 0 0"'
        f' solref="-{4e3 * IMPEDANCE} -{40.0}" solreffriction="-1e-6 -1"'
        f' solimp="{IMPEDANCE} {IMPEDANCE} .001 .5 2"/>'
        for k in range(4)
    )
    return f"""<mujoco><compiler angle="radian" autolimits="true"/>
<option timestep="{STEP}" integrator="implicitfast" cone="elliptic" gravity="{_v(gravity)}"
 solver="Newton" iterations="30" tolerance="1e-10"/>
<worldbody><geom name="ground" type="plane" size="0 0 1" contype="0" conaffinity="0"/>
<body name="chassis" pos="0 0 {n.h - sunk}" quat="{cos(heading / 2)} 0 0 {sin(heading / 2)}"><freejoint/>
<inertial pos="{ahead} 0 0" mass="{mass}" diaginertia="{ixx} {iyy} {izz}"/>
<site name="cg" pos="0 0 0"/><site name="axis" pos="0 0 {-n.h}"/>
{_imu(rover)}{_pendulum(rover)}{_sliding(rover)}{legs}</body></worldbody>
<contact>{pairs}</contact>{_lock(rover)}
<actuator>{_actuators(rover)}</actuator>
<sensor><gyro site="imu"/><accelerometer site="imu"/><framelinvel objtype="site" objname="imu"/>
<framequat objtype="site" objname="cg"/><velocimeter site="axis"/><accelerometer site="cg"/>
</sensor></mujoco>"""


def _v(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def _mu(rover: EngineRover) -> float:
    return min(rover.numbers.mu, MU)


def _leg(rover: EngineRover, k: int, sprung: float, ahead: float) -> str:
    n, radius = rover.numbers, rover.instruments.wheel_radius
    front, left = CORNERS[k]
    stiffer = rover.own.get("front_share", 0.5) * 2
    stiffer = stiffer if front > 0 else 2 - stiffer
    wheel, ks = (n.m - n.ms) / 4, stiffer * spring(rover)
    base = n.a + n.b
    lever = (n.b + ahead) if front > 0 else (n.a - ahead)
    load = sprung * GRAVITY * cos(n.slope) * lever / base / 2
    place = (n.a if front > 0 else -n.b, left * n.track, radius - n.h)
    trail = rover.own.get("toe", 0.0) > 0.0
    limit = rover.own.get("bump", 0.0)
    travel = f' limited="true" range="{-limit} {limit}" solreflimit="0.01 1"' if limit else ""
    inertia = 0.4 * HUB * wheel * radius**2
    steer = f'<joint name="steer{k}" type="hinge" axis="0 0 1"/>' if front > 0 else ""
    rolling = 0.4 * (1 - HUB) * wheel * radius**2
    return f"""<body pos="{_v(place)}"><joint type="slide" axis="0 0 1" stiffness="{ks}"
 damping="{stiffer * n.bphi / n.track**2}" springref="{-load / ks}" 
 frictionloss="{stiffer * n.friction / (2 * n.track)}"{travel}/>
<inertial pos="0 0 0" mass="{HUB * wheel / 2}" diaginertia="{inertia} {inertia} {inertia}"/>
<body>{steer}<inertial pos="0 0 0" mass="{HUB * wheel / 2}" diaginertia="{inertia} {inertia} {inertia}"/>
<body pos="{-0.3 * radius if trail and front > 0 else 0.0} 0 0"><joint name="roll{k}" type="hinge"
 axis="0 1 0" armature="{ROTOR * n.m * radius**2}"/><inertial pos="0 0 0" mass="{(1 - HUB) * wheel}"
 diaginertia="{rolling} {rolling} {rolling}"/><geom name="tyre{k}" type="sphere" size="{radius}"
 contype="0" conaffinity="0"/></body></body></body>"""


def _imu(rover: EngineRover) -> str:
    """The site of the sensors, tilted; on a mast where the rover has one."""
    n, i = rover.numbers, rover.instruments
    x, y, z = (angle / 2 for angle in i.tilt)
    norm = sqrt(1 + x * x + y * y + z * z)
    quat = _v((1 / norm, x / norm, y / norm, z / norm))
    place = (i.imu_x, 0.0, i.imu_z - n.h)
    period = rover.own.get("mast", 0.0)
    if not period:
        return f'<site name="imu" pos="{_v(place)}" quat="{quat}"/>'
    w, length, mass = 2 * 3.141592653589793 / period, 0.3 * (n.a + n.b), 0.01 * n.m
    about = mass * length**2 * 1.1
    stiff = about * w * w + mass * GRAVITY * length
    return f"""<body pos="{_v((place[0], 0.0, place[2] - length))}"><joint type="hinge" axis="1 0 0"
 stiffness="{stiff}" damping="{2 * 0.08 * w * about}"/><inertial pos="0 0 {length}" mass="{mass}"
 diaginertia="{0.1 * about} {0.1 * about} {0.1 * about}"/>
<site name="imu" pos="0 0 {length}" quat="{quat}"/></body>"""


def _pendulum(rover: EngineRover) -> str:
    """A share of the sprung mass that hangs at the height of the CG and swings sideways."""
    share, n = rover.own.get("pendulum", 0.0), rover.numbers
    if not share:
        return ""
    mass, length = share * n.ms, GRAVITY / rover.own["pendulum_w"] ** 2
    own = 0.05 * mass * length**2
    damping = 2 * 0.08 * rover.own["pendulum_w"] * mass * length**2
    return f"""<body pos="0 0 {length}"><joint type="hinge" axis="1 0 0" damping="{damping}"/>
<inertial pos="0 0 {-length}" mass="{mass}" diaginertia="{own} {own} {own}"/></body>"""


def _sliding(rover: EngineRover) -> str:
    """A share of the sprung mass that slides across the chassis with dry friction, between stops."""
    share, n = rover.own.get("sliding", 0.0), rover.numbers
    if not share:
        return ""
    mass, way = share * n.ms, 0.12 * n.track
    own = 0.02 * mass * n.track**2
    return f"""<body><joint type="slide" axis="0 1 0" limited="true" range="{-way} {way}" solreflimit="0.03 1"
 frictionloss="{0.12 * mass * GRAVITY}" damping="{mass}"/>
<inertial pos="0 0 0" mass="{mass}" diaginertia="{own} {own} {own}"/></body>"""


def _lock(rover: EngineRover) -> str:
    """A viscous coupling between the rear wheels; a large one locks them."""
    if not rover.numbers.diff_c:
        return ""
    # N m s/rad of the coupling for a yaw moment of diff_c track^2 / 2 a unit of r / V
    damping = rover.numbers.diff_c / 2 * rover.instruments.wheel_radius**2 / rover.speed
    return f"""<tendon><fixed damping="{damping}"><joint joint="roll2" coef="1"/>
<joint joint="roll3" coef="-1"/>
</fixed></tendon>"""


def _actuators(rover: EngineRover) -> str:
    n, radius, toe = rover.numbers, rover.instruments.wheel_radius, rover.own.get("toe", 0.0)
    wheel = (n.m - n.ms) / 4
    inertia = 0.4 * wheel * radius**2 * (HUB / 2 + 1 - HUB)
    stiff, damping = inertia * STEERING_W**2, 2 * inertia * STEERING_W
    if toe:  # the steered wheels give way to the moment of their trail, slowly
        stiff = 0.3 * radius * n.Cf / 2 / toe
        damping = stiff * rover.own["toe_lag"]
    servos = "".join(f'<position joint="steer{k}" kp="{stiff}" kv="{damping}"/>' for k in (0, 1))
    return servos + '<motor joint="roll2"/><motor joint="roll3"/>'


# ---- Effects that MuJoCo makes by its own contacts, joints and bodies.

FRONT_SHARE = 0.8  # of the roll stiffness, where a front wheel lifts


def _bumps(rover: Rover, size: float, _extras: Extras) -> Rover:
    """Travel of a leg: 1/size of what the large amplitude asks for."""
    return cast(EngineRover, rover).having(bump=_travel(rover, size))


def _travel(rover: Rover, size: float) -> float:
    n = rover.numbers
    lean = n.ms * n.h * peak_ay(rover) / (n.kphi - n.ms * GRAVITY * n.h)
    return lean * n.track / 2 / size


def _narrow(rover: Rover, size: float, _extras: Extras) -> Rover:
    """A narrow track on springs that carry the roll moment in front; its roll stiffness stays as it is."""
    track = lifted_track(rover, size)
    return cast(EngineRover, rover.of(track=track)).having(front_share=FRONT_SHARE)


def lifted_track(rover: Rover, size: float) -> float:
    """Track [m] at which a front wheel lifts at 1/size of a steady turn's a_y at the large amplitude."""
    return 4 * FRONT_SHARE * rover.numbers.h * peak_ay(rover) / size / GRAVITY


LISTED: tuple[Law, ...] = (
    *PATH,
    *AROUND,
    *SENSING,
    *vehicle_laws(
        ("suspension_friction", "tanh"), ("cross_slope", "plane"), ("front_rear_stiffness", "ratio")
    ),
    Law(
        "tyre_saturation",
        "friction cone",
        "tyre",
        0.7,
        1.5,
        valued("mu", friction_limit),
        "-",
        friction_limit,
    ),
    Law("yaw_damping", "coupled wheels", "yaw", 0.05, 10.0, valued("diff_c", coupling), "N m s/rad", damping),
)
OUTSIDE: tuple[Law, ...] = (
    *outside_laws(("outside:cubic_hysteresis", "outside:resonant_linkage", "outside:aliased_vibration")),
    *OWN_PARTS,
    Law("outside:sliding_load", "dry friction and stops", "cargo", 0.04, 0.4, own_numbers(sliding="size")),
    Law("outside:flexing_mast", "IMU on a hinge", "imu", 0.08, 0.4, own_numbers(mast="size"), "s"),
    Law("outside:bump_stops", "stops of the legs", "roll", 1.2, 4.0, _bumps, "m", _travel),
    Law("outside:wheel_lift", "contact opens", "tyre", 0.6, 1.6, _narrow, "m", lifted_track),
)
PLACES: dict[str, tuple[str, ...]] = {**FOREIGN_PLACES, "outside:limping_motor": ("yaw moment", "speed")}


# ---- The loop of a run.

SLOWEST = 0.5  # m/s: below it tyres resist in proportion to the sliding speed
CUT = 0.45  # share of the time in which a limping motor drags
COLUMNS = 13 + 3 + 3


def _step_of_the_library() -> Callable[[int, int], None]:
    library = next(Path(mujoco.__file__).parent.glob("libmujoco*"))
    step: Any = ctypes.CDLL(str(library)).mj_step
    step.argtypes, step.restype = [ctypes.c_void_p, ctypes.c_void_p], None
    return step  # type: ignore[no-any-return]


_STEP = _step_of_the_library()


@njit
def _run(
    addresses: tuple[int, int],
    command: Array,
    wanted: Array,
    around: Array,
    n: Numbers,
    special: Array,
    views: tuple[Array, ...],
) -> Array:
    """(steps, COLUMNS) of the sensors. special: radius [m], the four R [1/kg], share of the slip that goes
    with speed and its reference [m/s], drag of a limping motor [N m] and its period [s], height of the CG.
    views: ctrl, xfrc of the chassis (6,), solreffriction (4, 2), sensordata."""
    ctrl, push, friction, sensed = views
    radius, part, reference, drag, period, h = (
        special[0], special[5], special[6], special[7], special[8], special[9],
    )  # fmt: skip
    out = np.empty((command.size, COLUMNS))
    servo = np.zeros(STEERING_STATES)
    before = front = slip = 0.0
    base = n.a + n.b
    for k in range(command.size):
        w, x, y, z = sensed[9], sensed[10], sensed[11], sensed[12]
        psi = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        phi = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        u, r = sensed[13], sensed[2]
        delta = steering_step(servo, command[k], u, front, slip, n, DT)
        for j in range(2):
            left = n.track / 2 if j == 0 else -n.track / 2
            ctrl[j] = delta * (1.0 + n.ackermann * delta * left / base) + n.roll_steer_front * phi
        drive = max(-n.most_drive, min(n.most_drive, (wanted[k] - u) / n.tau_drive)) * n.m
        drive -= n.rolling * n.m * 9.81 * np.tanh(u / 0.05)
        ctrl[2] = ctrl[3] = drive * radius / 2
        if drag > 0.0 and (k * DT / period) % 1.0 < CUT:
            ctrl[2] -= drag * np.tanh(u)
        speed = max(SLOWEST, abs(u))
        if part > 0.0:
            speed = speed ** (1.0 - part) * reference**part
        for j in range(4):
            stiffness = (n.Cf if j < 2 else n.Cr) / 2 * around[k, SURFACE]
            friction[j, 1] = -IMPEDANCE * stiffness * special[1 + j] / speed
        cos, sin = np.cos(psi), np.sin(psi)
        wind = around[k, WIND_Y] * cos - around[k, WIND_X] * sin
        side = around[k, ROAD_Y] + wind  # acts at the ground, the wind above it
        push[0] = around[k, WIND_X] * cos * cos + around[k, WIND_Y] * sin * cos - side * sin
        push[1] = around[k, WIND_X] * cos * sin + around[k, WIND_Y] * sin * sin + side * cos
        roll = around[k, ROAD_ROLL] + side * h - wind * n.wind_z
        push[3], push[4] = roll * cos, roll * sin
        push[5] = around[k, ROAD_YAW] + wind * n.wind_x - n.yaw_c * r - n.yaw_c2 * r * abs(r)
        _STEP(addresses[0], addresses[1])
        for j in range(COLUMNS):
            out[k, j] = sensed[j]
        front = (n.b * n.m * sensed[17] + n.Izz * (sensed[2] - before) / DT) / base
        slip = -front / n.Cf
        before = sensed[2]
    return out


def _signals(rover: EngineRover, command: Array, wanted: Array, around: Array, heading: float) -> Signals:
    build = built(rover, heading)
    model, data, own, n = build.model, build.data, rover.own, rover.numbers
    special = np.array(
        [
            rover.instruments.wheel_radius,
            *build.resistance,
            own.get("slip_speed", 0.0),
            rover.speed,
            own.get("drag", 0.0),
            own.get("drag_period", 1.0),
            n.h,
        ]
    )
    chassis = model.body("chassis").id
    views = (data.ctrl, data.xfrc_applied[chassis], model.pair_solreffriction, data.sensordata)
    found = _run((model._address, data._address), command, wanted, around, n, special, views)
    w, x, y, z = found[:, 9:13].T
    psi = np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    psi += 2 * np.pi * round((heading - psi[0]) / (2 * np.pi))
    cos, sin = np.cos(psi), np.sin(psi)
    return {
        "r": found[:, 2],
        "p": found[:, 0],
        "ay": found[:, 4],
        "vy": found[:, 7] * cos - found[:, 6] * sin,
        "speed": found[:, 13],
        "phi": np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        "psi": psi,
    }


ENGINE = Engine("mujoco", SIZES, _signals, LISTED, OUTSIDE, PLACES)
