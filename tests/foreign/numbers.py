"""All numbers of a rover of the foreign plant, and of every law that it may follow.

A NamedTuple of floats, so that numba compiles one kernel for every rover. A size of zero switches its law
off. A field that ends in `form` chooses among forms of one law; the law's file says which.
"""

from __future__ import annotations

from typing import NamedTuple


class Numbers(NamedTuple):
    """SI units, ISO 8855 axes; angles are road-wheel angles. The defaults switch every effect off."""

    # body, axles and suspension
    m: float
    ms: float  # sprung mass, CG at height h above the roll axis
    a: float
    b: float
    track: float
    Izz: float
    Ixx: float  # sprung mass about its own CG
    h: float
    kphi: float
    bphi: float
    roll_axis: float  # height above the ground; loads the wheels directly
    Cf: float  # N/rad of an axle
    Cr: float
    ackermann: float  # 0: parallel steering, 1: Ackermann's angles
    # servo: w = clip(gain (target - angle), rate), motor_lag w' = ...
    gain: float  # 1/s
    motor_lag: float  # s
    rate: float  # rad/s
    rate_form: float
    # drive
    tau_drive: float  # s
    most_drive: float  # m/s^2
    rolling: float  # rolling resistance over weight
    # steering effects
    trim: float = 0.0
    deadband: float = 0.0
    deadband_form: float = 0.0
    stiction: float = 0.0
    stiction_form: float = 0.0
    play: float = 0.0
    play_form: float = 0.0
    play_tau: float = 0.5
    curve: float = 0.0
    curve_form: float = 0.0
    asymmetry: float = 0.0
    asymmetry_form: float = 0.0
    speed_gain: float = 0.0
    speed_ref: float = 1.0
    resonance_w: float = 0.0
    resonance_z: float = 0.15
    compliance: float = 0.0
    compliance_form: float = 0.0
    compliance_lag: float = 0.004  # s: a linkage yields at once
    rear_share: float = 0.0
    roll_steer_front: float = 0.0
    roll_steer_rear: float = 0.0
    # tyres
    tyre_form: float = 0.0
    mu: float = 10.0
    load_form: float = 0.0
    load_k: float = 0.0
    sigma: float = 0.0
    sigma_form: float = 0.0
    tyre_dead_zone: float = 0.0
    tyre_left_right: float = 0.0
    slip_speed: float = 0.0  # stiffness goes with the speed over speed_ref to this power
    lift: float = 0.0  # factor on the load transfer of an axle whose inner wheel lifts
    lift_form: float = 0.0
    # moments on the body
    yaw_c: float = 0.0
    diff_c: float = 0.0
    yaw_c2: float = 0.0
    friction: float = 0.0
    friction_form: float = 0.0
    bump: float = 0.0  # rad: roll at which the stops touch
    bump_k: float = 0.0  # N m/rad beyond it
    wind_x: float = 0.0  # centre of pressure ahead of the CG
    wind_z: float = 0.0  # and above the roll axis
    # ground
    slope: float = 0.0
    slope_heading: float = 0.0  # downhill
    # loose load: a share of the mass that moves across the rover
    loose: float = 0.0
    loose_form: float = 0.0
    loose_w: float = 8.0
    loose_z: float = 0.15
