"""Options of the commands that drive a rover, real or simulated, as dataclasses that these commands share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.options import AS_JSON, FILE, FOLDER, FULL, SEED, Parsed, finite, gathered, option
from rover_sweep.cli.vehicle_link import ACCESS, MAYBE_CONNECT
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import (
    FIRST_DOUBLET,
    FIRST_SWEEPS,
    BiasSweep,
    Doublet,
    Manoeuvre,
    Sweep,
    ThrottleSweep,
)
from sitl.plant.variant import variant_names

if TYPE_CHECKING:
    from rover_sweep.session.content import SessionRun
    from rover_sweep.session.simulated_rover import Physics
    from rover_sweep.vehicle.link.connection import Access
    from rover_sweep.vehicle.run.controls import RunSettings, Trigger

LIMITS = ("pwm_max", "roll_max", "p_max", "r_max", "v_min", "v_max", "still", "gcs")


def manoeuvre_type(kind: type[Manoeuvre]) -> Parsed:
    """A manoeuvre: its numbers in their order, or by name, joined by commas."""
    own = [f for f in fields(kind) if f.name not in ("kind", "bias")]
    bias = [f for f in fields(kind) if f.name == "bias"]  # given after the amplitude
    keys = {f.name.replace("_", ""): f for f in (own[0], *bias, *own[1:])}

    def manoeuvre(text: str) -> Manoeuvre:
        numbers: dict[str, float] = {}
        for key, part in zip(keys, text.split(","), strict=False):
            name, _, value = part.rpartition("=")
            name = name.strip().lower() or key
            if name not in keys:
                raise ValueError(f"{text!r}: there is no {name!r}; there are {', '.join(keys)}")
            wrong = f"{text!r}: {value!r} is not a number; write it as 150,0.3,25,55 or 150,wmax=20"
            number = finite(value, wrong)
            if keys[name].type == "int" and not number.is_integer():
                raise ValueError(f"{text!r}: {name} must be a whole number")
            numbers[keys[name].name] = int(number) if keys[name].type == "int" else number
        if len(text.split(",")) > len(keys):
            raise ValueError(f"{text!r} has more numbers than {', '.join(keys)}")
        return kind(**numbers)  # type: ignore[arg-type]

    shown = [name.upper() for name in keys if name not in ("fade", "dwell", "straight", "count")]
    return Parsed(f"{shown[0]}[,{','.join(shown[1:])}]", manoeuvre)


def _limit(text: str) -> tuple[str, float]:
    """(name without SWP_, value)."""
    name, _, value = text.partition("=")
    name = name.strip().lower().removeprefix("swp_")
    if name not in LIMITS:
        raise ValueError(f"{text!r}: there is no limit {name!r}; there are {', '.join(LIMITS)}")
    return name, finite(value, f"{text!r}: {value!r} is not a number")


LIMIT = Parsed("NAME=VALUE", _limit)


PILOT_PATIENCE = 900.0  # s to wait for the pilot to arm, throw the switch, or disarm at the end


@dataclass(frozen=True)
class Manoeuvres:
    """The runs to drive; two sweeps and a doublet if none is given."""

    sweep: tuple[Sweep, ...] = option(
        "Sweep in us, rad/s, s; or by name, e.g. 150,wmax=20. May be repeated.",
        manoeuvre_type(Sweep),
        multiple=True,
    )
    doublet: tuple[Doublet, ...] = option(
        "Doublet in us and s, to verify the models. May be repeated.", manoeuvre_type(Doublet), multiple=True
    )
    multisine: tuple[Multisine, ...] = option(
        "Multisine: peak in us, rad/s, s; shows 2nd and 3rd harmonics. May be repeated.",
        manoeuvre_type(Multisine),
        multiple=True,
    )
    bias_sweep: tuple[BiasSweep, ...] = option(
        "Sweep about a steering offset in us, e.g. 80,100. May be repeated.",
        manoeuvre_type(BiasSweep),
        multiple=True,
    )
    throttle_sweep: tuple[ThrottleSweep, ...] = option(
        "Sweep of the throttle about the pilot's, in us, rad/s, s, for the speed gains. May be repeated.",
        manoeuvre_type(ThrottleSweep),
        multiple=True,
    )

    @property
    def runs(self) -> tuple[SessionRun, ...]:
        """Named, in driving order."""
        from rover_sweep.session.content import SessionRun

        given = any((self.sweep, self.doublet, self.multisine, self.bias_sweep, self.throttle_sweep))
        kinds: dict[str, tuple[Manoeuvre, ...]] = {
            "sweep": self.sweep if given else FIRST_SWEEPS,
            "multisine": self.multisine,
            "bias-sweep": self.bias_sweep,
            "doublet": self.doublet if given else (FIRST_DOUBLET,),
            "throttle": self.throttle_sweep,
        }
        numbered = {f"{name}{n}": each for name, same in kinds.items() for n, each in enumerate(same, 1)}
        return tuple(SessionRun("doublet" if n == "doublet1" else n, each) for n, each in numbered.items())


@dataclass(frozen=True)
class Permissions:
    """What this program may do to the rover in a run, and the limits of the applet."""

    arm: bool = option("Allow this program to arm and disarm the rover.")
    throttle: int | None = option(
        "With --arm: allow this program to drive, with this throttle PWM.", click.IntRange(1000, 2000), "US"
    )
    throw_switch: Trigger | None = option(
        "Allow this program to throw the applet's switch: by RC override (default) or by "
        "MAV_CMD_DO_AUX_FUNCTION (aux); pilot: not allowed.",
        click.Choice(["override", "aux", "pilot"]),
        is_flag=False,
        flag_value="override",
    )
    limit: tuple[tuple[str, float], ...] = option(
        "Limit of the applet, e.g. v_max=3. [default: as set on the rover]", LIMIT, multiple=True
    )

    def settings(self, kept: Mapping[str, float] | None = None) -> RunSettings:
        """The settings of runs on a real rover. kept: limits of the session that is continued."""
        from rover_sweep.vehicle.run.controls import RunSettings

        watched = {} if self.throttle is None else {"gcs": 1.0}
        extra = {**(kept or {}), **watched, **dict(self.limit)}
        return RunSettings(self.arm, self.throttle, self.throw_switch or "pilot", extra, PILOT_PATIENCE)


ARDUROVER = option("The ArduRover SITL program (else $ROVER_SWEEP_ARDUROVER, else the PATH).", FILE)
PERMISSIONS = gathered(Permissions)
SIMULATORS = ("plant", "embedded", "ardurover")


def simulator_option(default: str | None, choices: Sequence[str] = SIMULATORS[1:]) -> Any:
    """--simulator, which starts a rover that is simulated."""
    words = {
        "plant": "only the physics",
        "embedded": "the embedded rover",
        "ardurover": "the real firmware in SITL with the same physics",
    }
    meanings = "; ".join(f"{name}: {words[name]}" for name in choices)
    return option(f"Simulated rover to drive. {meanings}.", click.Choice(choices), default=default)


@dataclass(frozen=True)
class SimulationOptions:
    """A rover that is simulated."""

    simulator: str | None = simulator_option("plant", SIMULATORS)
    variant: str = option(
        f"Physics of the simulated rover: {', '.join(variant_names())}, or a TOML file (its table [effects] "
        "adds effects).",
        metavar="NAME|FILE",
        default="nominal",
    )
    ardurover: str | None = ARDUROVER
    seed: int = SEED

    @property
    def binary(self) -> Path | None:
        """The path of the ArduRover program, if it was given."""
        return Path(self.ardurover) if self.ardurover else None


PHYSICS = option(
    "Physics for the firmware: our plant, or the firmware's own rover.",
    click.Choice(("plant", "own")),
    default="plant",
)
SIMULATION = gathered(SimulationOptions)
DRIVEN_SIMULATION = gathered(SimulationOptions, simulator=simulator_option(None))
NO_LOG = option("Do not download the rover's log; use the telemetry.")


@dataclass(frozen=True)
class RunCall:
    """The options of `run` and `dry-run`."""

    connect: str | None = MAYBE_CONNECT
    access: Access = ACCESS
    vehicle: str | None = option(
        "Vehicle file. [default: rover.toml here; of a simulated rover, its true numbers]", FILE
    )
    manoeuvres: Manoeuvres = gathered(Manoeuvres)
    allowed: Permissions = PERMISSIONS
    no_log: bool = NO_LOG
    diagnose: bool = option("Run `diagnose` on the runs at the end.")
    simulation: SimulationOptions = DRIVEN_SIMULATION
    physics: Physics = PHYSICS
    out: str | None = option("Folder for recordings and report. [default: run, else run-2, ...]", FOLDER)
    as_json: bool = AS_JSON
    full: bool = FULL


RUN_CALL = gathered(RunCall)
