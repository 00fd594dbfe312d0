"""From what a user names - recordings and a vehicle file - to what the identification takes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.identify.geometry import Geometry
from rover_sweep.identify.grouping import Settings
from rover_sweep.identify.models.lumped import COLUMNS, ROWS
from rover_sweep.identify.recording import Note, Recording, steered
from rover_sweep.identify.soundness.rovers import with_rovers
from rover_sweep.known_steering import through_linkage
from rover_sweep.logs import read_runs
from rover_sweep.run_names import named, source_names
from rover_sweep.session_folder.folder import is_session
from rover_sweep.session_folder.recordings import session_runs
from rover_sweep.vehicle_file import Vehicle

STEERED = ("delta", "pwm", "r", "p", "phi", "psi", "ay", "vy")
LEFT_OUT = (
    "is no part of the fit: a sweep about a steering offset is linear about a turn, and the other runs about "
    "straight driving; identify it alone, or give it to diagnose"
)
MODEL_NAMES = {
    "roll_inertia": "Ixx", "roll_yaw_inertia": "Ixz", "cg_height_above_roll_centre": "h",
    "sprung_mass": "ms", "mass": "m", "cg_to_front_axle": "a", "cg_to_rear_axle": "b", "yaw_inertia": "Izz",
}  # fmt: skip


@dataclass(frozen=True)
class Reading:
    """How to read the recordings. columns: the map of a .csv (dict or path of a TOML file).

    filters: {"gyro_hz", "accel_hz"} [Hz] in place of the recorded sensor low-passes.
    system: MAVLink id of the vehicle in a .tlog that holds several.
    """

    columns: Mapping[str, Any] | str | None = None
    filters: Mapping[str, float] | None = None
    system: int | None = None


def geometry_of(vehicle: Vehicle) -> Geometry:
    """The numbers of a vehicle file as the models take them."""

    def value(number: Any) -> float | None:
        return None if number is None else float(number.value)

    forward, _, up = vehicle.imu_iso
    h = value(vehicle.cg_height_above_roll_centre)
    return Geometry(
        mass=vehicle.mass.value,
        a=vehicle.cg_to_front_axle.value,
        b=vehicle.cg_to_rear_axle.value,
        sprung_mass=value(vehicle.sprung_mass),
        h=h,
        roll_inertia=value(vehicle.roll_inertia),
        yaw_inertia=value(vehicle.yaw_inertia),
        imu_x=forward,
        imu_z=(h or 0.0) + up,
        free=tuple(MODEL_NAMES[name] for name in vehicle.free),
        roll_yaw_inertia=value(vehicle.roll_yaw_inertia) or 0.0,
        friction=value(vehicle.friction),
    )


def load(
    sources: Sequence[str], vehicle: Vehicle, reading: Reading, beside: Sequence[str] = ()
) -> tuple[Recording, ...]:
    """All runs of the sources with the steering angle in radians; beside: as in `load_runs`."""
    runs = load_runs(sources, reading.columns, reading.filters, beside, reading.system)
    return tuple(with_delta(run, vehicle) for run in runs)


def load_runs(
    sources: Sequence[str],
    columns: Mapping[str, Any] | str | None,
    filters: Mapping[str, float] | None,
    beside: Sequence[str] = (),
    system: int | None = None,
) -> tuple[Recording, ...]:
    """All runs of the sources as recorded, named apart from each other and from those of `beside`.

    A source is what `read_runs` reads, or the folder of a session.
    """
    names = source_names((*sources, *beside))
    found: list[Recording] = []
    for source in sources:
        if is_session(Path(source)):
            found += _of_session(source, filters, names)
        else:
            runs = read_runs(source, column_map=columns, filters=filters, system=system)
            found += [named(run, source, names[source]) for run in runs]
    return with_rovers(found)


def _of_session(
    source: str, filters: Mapping[str, float] | None, names: Mapping[str, str]
) -> tuple[Recording, ...]:
    """Under the names of its plan, with the folder's where there are other sources."""
    runs = session_runs(Path(source), filters)
    return runs if len(names) == 1 else tuple(replace(r, name=f"{names[source]}/{r.name}") for r in runs)


def with_delta(run: Recording, vehicle: Vehicle) -> Recording:
    """The run with its steering angle; DataRefused where no steering was recorded."""
    if "delta" in run:
        return run
    if "pwm" not in run:
        raise DataRefused(f"{run.name}: no steering was recorded; log RCOU, SWEP or SERVO_OUTPUT_RAW")
    return through_linkage(steered(run, *vehicle.steering()), vehicle)


def parameter_names(names: Sequence[str]) -> tuple[str, ...]:
    """Names of model parameters, given as such or by the vehicle file's key; UsageError for others."""
    derivatives = [f"{row}_{column}" for row in ROWS for column in COLUMNS]
    known = [*MODEL_NAMES.values(), "C", "Cf", "Cr", "k_phi", "b_phi", "tau", *derivatives]
    found = tuple(MODEL_NAMES.get(name, name) for name in names)
    for name in found:
        if name not in known:
            raise UsageError(f"there is no parameter {name!r}; choose from {', '.join(known)}")
    return found


def divided(runs: Sequence[Recording]) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """(runs to identify from, doublets to verify on); doublets alone are identified from.

    A linear model holds about one way of driving: sweeps about a steering offset are left out where there
    are straight runs, and a note on the first of these says so.
    """
    others, doublets = doublets_apart(runs)
    biased = [run.name for run in others if run.kind == "bias_sweep"]
    straight = tuple(run for run in others if run.kind != "bias_sweep")
    if not biased or not straight:
        return others, doublets
    note = Note("warning", f"{', '.join(biased)} {LEFT_OUT}")
    return (replace(straight[0], notes=(*straight[0].notes, note)), *straight[1:]), doublets


def doublets_apart(
    runs: Sequence[Recording],
) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """(all other runs, doublets); doublets alone are the runs."""
    doublets = tuple(r for r in runs if r.kind == "doublet")
    others = tuple(r for r in runs if r.kind != "doublet")
    return (others, doublets) if others else (doublets, ())


def check_settings(settings: Settings, runs: Sequence[Recording]) -> None:
    """UsageError for settings that these runs cannot carry."""
    longest = max(run.span[1] - run.span[0] for run in runs)
    fastest = math.pi * min(run[c].rate for run in runs for c in ("delta", "r") if c in run)
    limits = (x for band in settings.bands.values() for x in band)
    numbers = [*(settings.band or ()), *(settings.windows or ()), *limits]
    if not all(math.isfinite(x) for x in numbers):
        raise UsageError("frequencies and window lengths must be finite numbers")
    if "r" not in settings.fitted or not {"ay", "p"} & set(settings.fitted):
        raise UsageError("the fit needs the yaw rate and a_y or the roll rate: --fit r,ay or r,p")
    if settings.bootstrap != 0 and settings.bootstrap < 20:
        raise UsageError(
            f"{settings.bootstrap} bootstrap replicates tell nothing; take 20 or more, or 0 for none"
        )
    if settings.windows and not 0.5 <= min(settings.windows) <= max(settings.windows) <= longest:
        raise UsageError(f"window lengths must lie between 0.5 s and the longest run, {longest:.3g} s")
    if settings.band and settings.band[1] > fastest:
        raise UsageError(
            f"--wmax {settings.band[1]:g} is beyond what these logs resolve, {fastest:.3g} rad/s "
            "(half the sampling rate of steering or yaw rate)"
        )
    if settings.band and settings.band[0] < 2 * math.pi / longest:
        raise UsageError(
            f"--wmin {settings.band[0]:g} rad/s has a period longer than the longest run, {longest:.3g} s"
        )
    _check_inputs(settings.condition_on, runs)
    for name, (low, high) in settings.bands.items():
        if high > fastest or low < 2 * math.pi / longest or high < 1.5 * low:
            within = f"{2 * math.pi / longest:.2g} and {fastest:.3g} rad/s"
            raise UsageError(
                f"--band {name}={low:g}:{high:g} must lie between {within} and span a factor of 1.5 or more"
            )


def _check_inputs(names: Sequence[str], runs: Sequence[Recording]) -> None:
    """What the responses are conditioned on must be recorded, and be neither the steering nor an answer."""
    for name in names:
        if name in STEERED:
            raise UsageError(f"{name} is the steering or follows it; condition on what moves by itself")
        lacking = [run for run in runs if name not in run]
        if lacking:
            there = ", ".join(c for c in lacking[0].channels if c not in STEERED) or "nothing else"
            raise UsageError(f"{lacking[0].name} has no {name!r} to condition on; recorded there: {there}")


def refuse_overlap(sweeps: Sequence[Recording], checks: Sequence[Recording]) -> None:
    """UsageError where a run would be its own judge, or counted twice; a copy of a file is that file."""
    for group in (sweeps, checks):
        for one, two in combinations(group, 2):
            if same_recording(one, two):
                told = "is given twice" if one.name == two.name else f"is the same recording as {one.name}"
                raise UsageError(f"{two.name} {told}, which would count its noise as known; give it once")
    for sweep, check in product(sweeps, checks):
        if same_recording(sweep, check):
            copied = "" if sweep.name == check.name else f" (it is the same recording as {sweep.name})"
            raise UsageError(
                f"{check.name} is both identified from and verified on{copied}; verify on another run"
            )


def same_recording(one: Recording, two: Recording) -> bool:
    """Are both the same run of the same file, whatever its name; a pair counts as each of its logs.

    Told by the files' SHA-256. Runs of one file are told apart by their time, and by their yaw rate where
    a file joins trials whose clocks begin anew.
    """
    first, second = ({digest for _, digest in run.sources} for run in (one, two))
    if not first & second:
        return False
    if first == second:
        return one.span == two.span and np.array_equal(one["r"].x, two["r"].x)
    shared = min(one.span[1], two.span[1]) - max(one.span[0], two.span[0])
    nested = first < second or second < first
    return nested and shared > 0.5 * min(run.span[1] - run.span[0] for run in (one, two))
