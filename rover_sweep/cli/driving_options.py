"""Options of the commands that drive a rover, real or simulated, as dataclasses that these commands share."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.options import AS_JSON, FILE, FOLDER, FULL, SEED, gathered, option
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

# Manoeuvres and limits on the command line: 150 or 150,0.3,25,55 or 150,wmax=20; roll_max=20.


_SWEEP = {
    "amplitude": "amplitude",
    "wmin": "w_min",
    "wmax": "w_max",
    "trec": "t_rec",
    "fade": "fade",
    "dwell": "dwell",
    "straight": "straight",
}
_DOUBLET = {name: name for name in ("amplitude", "pulse", "pause", "count", "straight")}
_MULTISINE = dict(list(_SWEEP.items())[:4]) | {"periods": "periods"} | dict(list(_SWEEP.items())[4:])
_BIAS_SWEEP = {"amplitude": "amplitude", "bias": "bias"} | _SWEEP
_KEYS: dict[type[Manoeuvre], tuple[dict[str, str], int]] = {  # names in order, number of them shown in --help
    Sweep: (_SWEEP, 4),
    Doublet: (_DOUBLET, 3),
    Multisine: (_MULTISINE, 5),
    BiasSweep: (_BIAS_SWEEP, 5),
    ThrottleSweep: (_SWEEP, 4),
}
_WHOLE = ("count", "periods")
LIMITS = ("pwm_max", "roll_max", "p_max", "r_max", "v_min", "v_max", "still", "gcs")


class ManoeuvreType(click.ParamType):
    """A manoeuvre: its numbers in their order, or by name, joined by commas."""

    def __init__(self, kind: type[Manoeuvre]) -> None:
        self.kind = kind
        self.keys, shown = _KEYS[kind]
        first = [name.upper() for name in list(self.keys)[:shown]]
        self.name = f"{first[0]}[,{','.join(first[1:])}]"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> Manoeuvre:
        """The manoeuvre; a usage error that names the wrong part."""
        if isinstance(value, Manoeuvre):
            return value
        numbers: dict[str, float] = {}
        for key, part in zip(self.keys, str(value).split(","), strict=False):
            name, _, text = part.rpartition("=")
            name = name.strip().lower() or key
            if name not in self.keys:
                self.fail(f"{value!r}: there is no {name!r}; there are {', '.join(self.keys)}", param, ctx)
            numbers[self.keys[name]] = self._number(text, str(value), param, ctx)
        if len(str(value).split(",")) > len(self.keys):
            self.fail(f"{value!r} has more numbers than {', '.join(self.keys)}", param, ctx)
        for name in (name for name in _WHOLE if name in numbers):
            if not numbers[name].is_integer():
                self.fail(f"{value!r}: {name} must be a whole number", param, ctx)
            numbers[name] = int(numbers[name])
        try:
            return self.kind(**numbers)  # type: ignore[arg-type]
        except ValueError as error:
            self.fail(str(error), param, ctx)

    def _number(
        self, text: str, whole: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            self.fail(
                f"{whole!r}: {text!r} is not a number; write it as 150,0.3,25,55 or 150,wmax=20", param, ctx
            )
        return number


class LimitType(click.ParamType):
    """A limit of the applet by its name without SWP_, e.g. roll_max=20."""

    name = "NAME=VALUE"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, float]:
        """(name, value)."""
        name, _, text = str(value).partition("=")
        name = name.strip().lower().removeprefix("swp_")
        if name not in LIMITS:
            self.fail(f"{value!r}: there is no limit {name!r}; there are {', '.join(LIMITS)}", param, ctx)
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            self.fail(f"{value!r}: {text!r} is not a number", param, ctx)
        return name, number


# What is driven, what this program may do, and the rover that is simulated.


PILOT_PATIENCE = 900.0  # s to wait for the pilot to arm, throw the switch, or disarm at the end


@dataclass(frozen=True)
class Manoeuvres:
    """The runs to drive; two sweeps and a doublet if none is given."""

    sweep: tuple[Sweep, ...] = option(
        "Sweep in us, rad/s, s; or by name, e.g. 150,wmax=20. May be repeated.",
        ManoeuvreType(Sweep),
        multiple=True,
    )
    doublet: tuple[Doublet, ...] = option(
        "Doublet in us and s, to verify the models. May be repeated.", ManoeuvreType(Doublet), multiple=True
    )
    multisine: tuple[Multisine, ...] = option(
        "Multisine: peak in us, rad/s, s; shows 2nd and 3rd harmonics. May be repeated.",
        ManoeuvreType(Multisine),
        multiple=True,
    )
    bias_sweep: tuple[BiasSweep, ...] = option(
        "Sweep about a steering offset in us, e.g. 80,100. May be repeated.",
        ManoeuvreType(BiasSweep),
        multiple=True,
    )
    throttle_sweep: tuple[ThrottleSweep, ...] = option(
        "Sweep of the throttle about the pilot's, in us, rad/s, s, for the speed gains. May be repeated.",
        ManoeuvreType(ThrottleSweep),
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
        "Limit of the applet, e.g. v_max=3. [default: as set on the rover]", LimitType(), multiple=True
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
