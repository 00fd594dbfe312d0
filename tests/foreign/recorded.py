"""A run of a rover as the tool's `Recording`, in memory."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from rover_sweep.api.read import Runs, with_delta
from rover_sweep.data.recording import LowPass, Recording, Signal
from rover_sweep.data.vehicle_file import parse
from tests.foreign.chassis import STATES
from tests.foreign.drive import AFTER, BRAKING, STILL, STRAIGHT, Drive, command, output_us, wanted_speed
from tests.foreign.instruments import felt, sensed
from tests.foreign.motion import DT, integrated
from tests.foreign.rover import Instruments, Rover, vehicle_toml
from tests.foreign.surroundings import around

Array = NDArray[np.float64]
UNITS = {"r": "rad/s", "p": "rad/s", "ay": "m/s^2", "vy": "m/s", "speed": "m/s", "phi": "rad", "psi": "rad"}
OF_EKF = ("vy", "speed")


def driven(
    rover: Rover, drive: Drive, rng: Generator, noise: bool = True
) -> tuple[Array, Array, dict[str, Array]]:
    """(main loops (k,) [s], PWM (k,) [us], {channel: (steps,)}) of a run; noise: of road and sensors."""
    t_out, us = output_us(drive, rover, np.random.default_rng(int(drive.opened * 1e6)))
    start = np.zeros(STATES)
    start[5] = drive.heading
    ground = around(rover, drive, rng, noise)
    motion = integrated(command(drive, rover, t_out, us), wanted_speed(drive), ground, start, rover.numbers)
    return t_out, us, sensed(felt(motion, rover), rover.instruments, rng, noise)


def recorded(rover: Rover, drive: Drive, rng: Generator) -> Recording:
    """The run as the firmware logs it; time is since boot."""
    return logged(rover.instruments, drive, *driven(rover, drive, rng), "foreign plant")


def logged(
    i: Instruments, drive: Drive, t_out: Array, us: Array, x: Mapping[str, Array], firmware: str
) -> Recording:
    """A log of signals (steps,) before they are sampled. t_out, us (k,): main loops [s] and PWM [us]."""
    boot = round(drive.opened, 6)
    steps = np.minimum((t_out / DT).astype(int), x["r"].size - 1)
    every = max(1, round(i.loop_hz / i.ekf_hz))
    channels = {"pwm": Signal(t_out + boot, us, "us", "SWEP.Out at the main loop", hold=True)}
    for name, unit in UNITS.items():
        at = slice(None, None, every if name in OF_EKF else 1)
        channels[name] = Signal(t_out[at] + boot, x[name][steps][at], unit, name)
    throttle = np.where((t_out > STILL) & (t_out < drive.end), 1700.0, 1500.0)
    channels["throttle"] = Signal(t_out + boot, throttle, "us", "throttle", hold=True)
    gyro, accel = LowPass(i.gyro_hz, "INS_GYRO_FILTER"), LowPass(i.accel_hz, "INS_ACCEL_FILTER")
    digest = hashlib.sha256(channels["r"].x.tobytes()).hexdigest()
    begin, end = boot + drive.begin, boot + drive.end
    return Recording(
        drive.name,
        channels,
        (begin, end),
        drive.kind,
        standstill=((boot + 0.3, boot + STILL - 0.3), (end + BRAKING + 0.5, end + BRAKING + AFTER - 0.3)),
        straight=((begin - 1.0, begin + STRAIGHT), (end - STRAIGHT + 1.0, end)),
        filters={"r": gyro, "p": gyro, "ay": accel},
        firmware=firmware,
        sources=((f"{drive.name}.BIN", digest),),
    )


def runs_of(rover: Rover, plan: tuple[Drive, ...], seed: int) -> tuple[Runs, tuple[Recording, ...]]:
    """(runs to fit, held out) with their vehicle, as `rs.read` gives them."""
    vehicle = parse(vehicle_toml(rover.told))
    rng = np.random.default_rng(seed)
    found = tuple(with_delta(recorded(rover, drive, rng), vehicle) for drive in plan)
    return Runs(found[:3], vehicle), found[3:]
