"""A rover as MuJoCo's bodies, joints and contacts (XML of MuJoCo 3 and later).

A free chassis with its CG at height h above the ground, four legs that slide along its z axis, wheels as
spheres on hinges; the front wheels steer. Legs that slide along z carry the side force at the ground, so the
roll axis lies in the ground. Front and rear springs are chosen for the roll stiffness of the drawn rover;
half of it is in front, or more where a front wheel is to lift.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin, sqrt

import mujoco

from tests.engines.rover import EngineRover
from tests.foreign.chassis import GRAVITY

STEP = 1e-3  # s
IMPEDANCE = 0.1  # of the contacts: a soft constraint adds a mass of only a few per cent of the wheel's
TYRE_OVER_LEG = 20.0  # vertical stiffness
STEERING_W = 400.0  # rad/s, of the position servo at each front wheel
HUB = 0.4  # share of the unsprung mass that does not roll
ROTOR = 0.03  # of the rover's mass: motor and gear at the rolling radius of each wheel
MU = 1.2
PLACES = ((1.0, 0.5), (1.0, -0.5), (-1.0, 0.5), (-1.0, -0.5))  # front or rear, share of the track to the left


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
    wheel = (n.m - n.ms) / 4
    loose = own.get("pendulum", 0.0) + own.get("sliding", 0.0)
    ahead = -2 * wheel * (n.a - n.b) / n.ms  # CG of the chassis from the CG of the whole
    unsprung_yaw = 4 * wheel * (n.track / 2) ** 2 + 2 * wheel * (n.a**2 + n.b**2)
    izz = max(n.Izz - unsprung_yaw - n.ms * ahead**2, 0.3 * n.Izz)
    iyy = max(1.05 * izz - n.Ixx, n.ms * (0.25 * (n.a + n.b)) ** 2)
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
<inertial pos="{ahead} 0 0" mass="{mass}" diaginertia="{n.Ixx * (1 - 0.5 * loose)} {iyy} {izz}"/>
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
    front, left = PLACES[k]
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
