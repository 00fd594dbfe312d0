"""A rover as a kinematic tree of exudyn on four rolling discs.

The chassis has six joints to the ground. Two solid axles hang on it by roll hinges, which lie at the height
of the roll axis and carry springs and dampers. The front wheels steer on the front axle. Discs of the
library's ObjectConnectorRollingDiscPenalty touch the ground: dry friction times the wheel load, in proportion
to the sliding speed up to the end of its zone. The end of the zone follows the speed of the rover, so that a
tyre has a stiffness for its slip angle. Bodies, joints and contacts in SI units, axes of ISO 8855.
"""

from __future__ import annotations

import contextlib
import io
import sys
from dataclasses import dataclass, replace
from math import cos, pi, sin, sqrt
from typing import Any

import numpy as np

from tests.engines.engine import EngineRover
from tests.engines.shared_laws import chassis_inertia
from tests.foreign.plant import BED_FRICTION, BED_WAY, GRAVITY, STOP_W

sys.exudynFast = True  # type: ignore[attr-defined]  # without checks of ranges
with contextlib.redirect_stdout(io.StringIO()):
    import exudyn as exu
    from exudyn import itemInterface as item

MU = 1.2
BOUNCE_W = 2 * pi * 20  # rad/s, of the rover on its tyres, above all that the sensors show
TYRE_OVER_SPRING = 40.0  # at least, roll stiffness
STEERING_W = 300.0  # rad/s, of the position servo at each front wheel
ROLLING = 0.6  # share of the unsprung mass that rolls
ROTOR = 0.01  # of the rover's mass: motor and gear at the rolling radius of a rear wheel
TRAIL = 0.3  # of the radius, where the steered wheels yield
SLIDE = 0.02  # m/s or rad/s: below it dry friction goes with the speed
X, Y, YAW, PITCH, ROLL = 0, 1, 3, 4, 5
HINGE_F, HINGE_R, STEER_L, STEER_R, REAR_L, REAR_R = 6, 7, 8, 9, 12, 13


@dataclass(frozen=True)
class Build:
    """A system that is ready to run. discs: front left, front right, rear left, rear right.

    zone: end of the proportional zone over the speed, front and rear. mu: of the discs.
    """

    mbs: Any
    tree: Any
    discs: tuple[Any, ...]
    joints: int
    zone: tuple[float, float]
    mu: float


@dataclass(frozen=True)
class _Link:
    """joint, link that carries it, place in that link, mass, inertia about the CG, CG, spring, damper."""

    joint: Any
    parent: int
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mass: float = 0.0
    inertia: tuple[float, float, float] = (0.0, 0.0, 0.0)
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spring: float = 0.0
    damper: float = 0.0


def built(rover: EngineRover, heading: float) -> Build:
    """The rover at rest on its tyres."""
    system = exu.SystemContainer()
    mbs = system.AddSystem()
    n, own, radius = rover.numbers, rover.own, rover.instruments.wheel_radius
    links = _links(rover)
    start = [0.0] * len(links)
    start[2], start[YAW] = n.h + n.roll_axis, heading
    node = mbs.AddNode(
        item.NodeGenericODE2(
            numberOfODE2Coordinates=len(links),
            referenceCoordinates=[0.0] * len(links),
            initialCoordinates=start,
            initialCoordinates_t=[0.0] * len(links),
        )
    )
    tree = mbs.AddObject(_tree(rover, links, node))
    ground = mbs.AddMarker(item.MarkerBodyRigid(bodyNumber=mbs.AddObject(item.ObjectGround())))
    mu, base = min(n.mu, MU), n.a + n.b
    smooth = bool(own.get("smooth"))
    slope = (2.0 if smooth else 1.0) * mu * GRAVITY * n.m / base
    zone = (slope * n.b / n.Cf, slope * n.a / n.Cr)
    discs = []
    for k, (link, side) in enumerate(_wheels(rover)):
        spot = item.MarkerKinematicTreeRigid(objectNumber=tree, linkNumber=link, localPosition=[0, side, 0])
        memory = mbs.AddNode(item.NodeGenericData(initialCoordinates=[0, 0, 0], numberOfDataCoordinates=3))
        vertical = _vertical(rover)[0 if k < 2 else 1]
        disc = item.ObjectConnectorRollingDiscPenalty(
            markerNumbers=[ground, mbs.AddMarker(spot)],
            nodeNumber=memory,
            discRadius=radius,
            discAxis=[0, 1, 0],
            planeNormal=[0, 0, 1],
            contactStiffness=vertical,
            contactDamping=sqrt(vertical * (n.m - n.ms) / 4),
            dryFriction=[mu, mu],
            dryFrictionProportionalZone=zone[0 if k < 2 else 1],
            useLinearProportionalZone=not smooth,
        )
        discs.append(mbs.AddObject(disc))
    _connect(mbs, node, rover)
    mbs.Assemble()
    return Build(mbs, tree, tuple(discs), len(links), zone, mu)


def _vertical(rover: EngineRover) -> tuple[float, float]:
    """Vertical stiffness of a front and of a rear tyre [N/m]; both axles sink by the same amount."""
    n = rover.numbers
    mean = max(n.m * BOUNCE_W**2 / 4, TYRE_OVER_SPRING * n.kphi / n.track**2)
    return 2 * mean * n.b / (n.a + n.b), 2 * mean * n.a / (n.a + n.b)


def _wheels(rover: EngineRover) -> tuple[tuple[int, float], ...]:
    """Link of each disc and its place on the link's axis to the left [m]."""
    half = rover.numbers.track / 2
    if rover.own.get("spool"):
        return (10, 0.0), (11, 0.0), (REAR_L, half), (REAR_L, -half)
    return (10, 0.0), (11, 0.0), (REAR_L, 0.0), (REAR_R, 0.0)


def _links(rover: EngineRover) -> list[_Link]:
    """All bodies with their joints, in the order of the constants of this module."""
    n, own, radius, j = rover.numbers, rover.own, rover.instruments.wheel_radius, exu.JointType
    half, base, wheel = n.track / 2, n.a + n.b, (n.m - n.ms) / 4
    soft = sum(_vertical(rover)) * n.track**2 / 2  # roll stiffness of the tyres
    share = n.kphi / (1 - n.kphi / soft) / n.kphi  # so that springs and tyres together have kphi
    sunk = n.m * GRAVITY * n.b / base / 2 / _vertical(rover)[0]
    low = radius - sunk - n.roll_axis  # centre of the wheels above the hinges
    rolling, hub, beam = ROLLING * wheel, (1 - ROLLING) / 2 * wheel, (1 - ROLLING) * wheel
    thin = hub * (0.5 * radius) ** 2
    about_z = 0.4 * rolling * radius**2
    toe = own.get("toe", 0.0)
    turned = thin + about_z
    stiff, damper = turned * STEERING_W**2, 2 * turned * STEERING_W
    trail = 0.0
    if toe:  # the steered wheels give way to the moment of their trail
        trail = TRAIL * radius
        stiff = trail * n.Cf / 2 / toe
        damper = stiff * own["toe_lag"]

    def axle(place: float, mass: float) -> _Link:
        across = mass * n.track**2 / 12
        inertia = (across, 0.02 * across, across)
        springs = share * n.kphi / 2, share * n.bphi / 2
        return _Link(j.RevoluteX, ROLL, (place, 0.0, -n.h), mass, inertia, (0.0, 0.0, low), *springs)

    def spinning(parent: int, place: tuple[float, float, float], rotor: float) -> _Link:
        inertia = (about_z, 0.7 * rolling * radius**2 + rotor * n.m * radius**2, about_z)
        return _Link(j.RevoluteY, parent, place, rolling, inertia)

    links = [_Link(j.PrismaticX, -1), _Link(j.PrismaticY, 0), _Link(j.PrismaticZ, 1)]
    links += [_Link(j.RevoluteZ, 2), _Link(j.RevoluteY, YAW), _chassis(rover)]
    links += [axle(n.a, beam), axle(-n.b, 2 * beam)]
    for side in (half, -half):
        links.append(
            _Link(j.RevoluteZ, HINGE_F, (0.0, side, low), hub, (thin,) * 3, spring=stiff, damper=damper)
        )
    links += [spinning(steer, (-trail, 0.0, 0.0), 0.0) for steer in (STEER_L, STEER_R)]
    if own.get("spool"):
        one = spinning(HINGE_R, (0.0, 0.0, low), ROTOR)
        across = 2 * (about_z + rolling * half**2)
        links.append(replace(one, mass=2 * rolling, inertia=(across, 2 * one.inertia[1], across)))
    else:
        links += [spinning(HINGE_R, (0.0, side, low), ROTOR) for side in (half, -half)]
    return [*links, *_loads(rover)]


def _chassis(rover: EngineRover) -> _Link:
    loose = rover.own.get("pendulum", 0.0) + rover.own.get("sliding", 0.0)
    ahead, *inertia = chassis_inertia(rover)
    mass = rover.numbers.ms * (1 - loose)
    return _Link(exu.JointType.RevoluteX, PITCH, mass=mass, inertia=tuple(inertia), centre=(ahead, 0.0, 0.0))


def _loads(rover: EngineRover) -> list[_Link]:
    """A hanging load at the height of the CG, or one that slides across the chassis."""
    own, n = rover.own, rover.numbers
    found = []
    if own.get("pendulum"):
        mass, w = own["pendulum"] * n.ms, own["pendulum_w"]
        length = GRAVITY / w**2
        small = (0.05 * mass * length**2,) * 3
        found.append(
            _Link(
                exu.JointType.RevoluteX, ROLL, (0.0, 0.0, length), mass, small, (0.0, 0.0, -length),
                damper=2 * 0.08 * w * mass * length**2,
            )
        )  # fmt: skip
    if own.get("sliding"):
        mass = own["sliding"] * n.ms
        small = (0.02 * mass * n.track**2,) * 3
        found.append(_Link(exu.JointType.PrismaticY, ROLL, mass=mass, inertia=small, damper=mass))
    return found


def _tree(rover: EngineRover, links: list[_Link], node: Any) -> Any:
    n, count = rover.numbers, len(links)
    fall = GRAVITY * sin(n.slope)
    down = [fall * cos(n.slope_heading), fall * sin(n.slope_heading), -GRAVITY * cos(n.slope)]
    return item.ObjectKinematicTree(
        nodeNumber=node,
        gravity=down,
        jointTypes=[one.joint for one in links],
        linkParents=[one.parent for one in links],
        jointTransformations=exu.Matrix3DList([np.eye(3)] * count),
        jointOffsets=exu.Vector3DList([list(one.place) for one in links]),
        linkInertiasCOM=exu.Matrix3DList([np.diag(one.inertia) for one in links]),
        linkCOMs=exu.Vector3DList([list(one.centre) for one in links]),
        linkMasses=[one.mass for one in links],
        jointForceVector=[0.0] * count,
        jointPositionOffsetVector=[0.0] * count,
        jointVelocityOffsetVector=[0.0] * count,
        jointPControlVector=[one.spring for one in links],
        jointDControlVector=[one.damper for one in links],
    )


def _connect(mbs: Any, node: Any, rover: EngineRover) -> None:
    """Dry friction and stops of the hinges and of a sliding load."""
    n, own = rover.numbers, rover.own
    fixed = mbs.AddMarker(
        item.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(item.NodePointGround()), coordinate=0)
    )

    def connector(joint: int, **options: Any) -> None:
        moving = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=node, coordinate=joint))
        memory = mbs.AddNode(item.NodeGenericData(initialCoordinates=[0, 0, 0], numberOfDataCoordinates=3))
        mbs.AddObject(
            item.ObjectConnectorCoordinateSpringDamperExt(
                markerNumbers=[fixed, moving], nodeNumber=memory, **options
            )
        )

    def stops(joint: int, way: float, stiffness: float, damping: float) -> None:
        limits = {"limitStopsUpper": way, "limitStopsLower": -way}
        connector(
            joint, useLimitStops=True, limitStopsStiffness=stiffness, limitStopsDamping=damping, **limits
        )

    # the light axle must not jump from one side of the friction to the other within a step
    zone = max(SLIDE, n.friction / 2 / ((n.m - n.ms) * n.track**2 / 16) / 500.0)
    for joint in (HINGE_F, HINGE_R):
        if n.friction:
            connector(joint, dynamicFrictionForce=n.friction / 2, frictionProportionalZone=zone)
        if n.bump:
            stops(joint, n.bump, n.bump_k / 2, 0.005 * n.bump_k)
    if own.get("sliding"):
        mass, joint = own["sliding"] * n.ms, len(_links(rover)) - 1
        friction = BED_FRICTION * mass * GRAVITY
        connector(joint, dynamicFrictionForce=friction, frictionProportionalZone=SLIDE)
        stops(joint, BED_WAY * n.track, mass * STOP_W**2, mass * STOP_W)
