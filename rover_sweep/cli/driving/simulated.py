"""`run --vehicle embedded|ardurover`: start a simulated rover and run the whole workflow on it.

The rover starts with factory settings: applet and parameters are installed as on a real one. The program
arms and drives it without asking.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from itertools import takewhile
from math import radians, sin
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.driving.job import Job, announce
from rover_sweep.cli.options import ARDUROVER, FILE, gathered, option, session_folder
from rover_sweep.errors import UsageError, missing_extra

if TYPE_CHECKING:
    from collections.abc import Callable

    from rover_sweep.cli.views.display import PlainDisplay
    from rover_sweep.data.vehicle_file import Vehicle
    from rover_sweep.identification.pipeline import Identification
    from rover_sweep.report.document import Table
    from rover_sweep.session.session import SessionPlan
    from rover_sweep.session.simulated_rover import Physics, SimulatedRover, Simulator
    from rover_sweep.vehicle.events import Event, SessionFinished
    from sitl.plant.variant import PlantParameters

    Numbers = Callable[[Identification], Table | None]

# Simulated rovers of `dry-run` and `run`: their vehicle files and true parameters.


SIMULATORS = ("embedded", "ardurover")
_DEFAULTS = {"physics": "plant", "variant": "nominal", "seed": 1}


def variants() -> tuple[str, ...]:
    """Names of the built-in physics."""
    from sitl.plant.variant import variant_names

    return variant_names()


def rover_text(variant: str) -> str:
    """rover.toml of a simulated rover: the values that an owner could measure."""
    from sitl.plant.variant import load_variant
    from sitl.rover_file import rover_file

    try:
        return rover_file(load_variant(variant), variant)
    except ValueError as error:
        raise UsageError(str(error)) from error


def firmware_rover_text() -> str:
    """rover.toml of ArduPilot's own simulated rover (SIM_Rover.h, 4.6.3): 35 deg of steering at 500 us, and
    the wheelbase that follows from its turning circle of 1.8 m. It has no tyres and no body, so the masses
    (those of the nominal plant) do not affect the identified model."""
    from sitl.plant.variant import load_variant
    from sitl.rover_file import rover_file

    half = 1.8 / 2 * sin(radians(35)) / 2
    own = replace(
        load_variant("nominal"),
        rad_per_us=round(radians(35) / 500, 6),
        cg_to_front_axle=round(half, 4),
        cg_to_rear_axle=round(half, 4),
    )
    return rover_file(own, "of the firmware")


def folder_with_rover(
    out: str | None, name: str, rover_file: str | None, variant: str | None
) -> tuple[Path, tuple[Vehicle, Path]]:
    """(a new session's folder, (vehicle, its file)): the given file, else one of the variant, in the folder.

    variant: None for the firmware's own rover. out, name: as in `session_folder`.
    """
    from rover_sweep.data.vehicle_file import load

    if rover_file:
        return session_folder(out, name), (load(rover_file), Path(rover_file))
    text = rover_text(variant) if variant is not None else firmware_rover_text()
    folder = session_folder(out, name, also=("rover.toml",))
    path = folder / "rover.toml"
    path.write_text(text, encoding="utf-8")
    return folder, (load(path), path)


def truth_view(variant: str) -> Callable[[Identification], Table | None]:
    """A function that makes the table of true and identified parameters."""

    def view(result: Identification) -> Table | None:
        from sitl.plant.effects.replaced_numbers import resolved
        from sitl.plant.variant import load_variant

        return truth_table(result, resolved(load_variant(variant)))

    return view


_PHYSICAL = ("roll-yaw", "bicycle")  # models with physical parameters, whose true values are known


def truth_table(result: Identification, rover: PlantParameters) -> Table | None:
    """True and identified numbers, else the recommended physical model's parameters; None without any."""
    from rover_sweep.data.results import number
    from rover_sweep.identification.acceptance import TITLES, usable
    from rover_sweep.report.document import Cell, Table
    from rover_sweep.report.wording import change, symbol, unit

    models = usable(result)
    name = next((n for n in (result.recommended, *_PHYSICAL) if n in models and n in _PHYSICAL), None)
    if name is None:
        return None
    true = truth(rover)
    free = tuple(e for e in models[name].fit.estimates if e.free)
    found = tuple(result.numbers) or free
    rows = tuple(
        (
            Cell(symbol(e.name)),
            Cell(unit(e.unit)),
            Cell(number(true[e.name])),
            Cell(number(e.value)),
            Cell(change(100 * (e.value / true[e.name] - 1)), "strong"),
        )
        for e in found
        if true.get(e.name)
    )
    tied = (
        "Cf = Cr: mean of both axles, at zero slip."
        if any(e.name == "C" for e in found)
        else "Cf, Cr: at zero slip."
    )
    note = (
        f"{tied} τ: lag and delay of the servo. The 90 % intervals above include a lag of the steering and "
        "the saturation of the tyres, and no other physics that the model leaves out."
    )
    if rover.effects:
        note += f" The rover also has effects that no model includes: {', '.join(rover.effects)}."
    column = "identified" if result.numbers else f"{TITLES[name]} model"
    headings = ("", "", "true", column, "difference %")
    return Table("True parameters of the simulated rover", headings, rows, note, 2)


def truth(rover: PlantParameters) -> dict[str, float]:
    """The plant's true parameters by the models' names, in SI units."""
    front, rear = rover.front_cornering_stiffness, rover.rear_cornering_stiffness
    return {
        "C": (front + rear) / 2,
        "Cf": front,
        "Cr": rear,
        "Izz": rover.yaw_inertia,
        "Ixx": rover.roll_inertia,
        "h": rover.cg_height_above_roll_centre,
        "k_phi": rover.roll_stiffness,
        "b_phi": rover.roll_damping,
        "tau": rover.servo_lag + rover.servo_delay,
    }


# The simulated rover of a diagnosis or a variant file, as it is exported to other programs.


WIDTH = 105  # of a line


@dataclass(frozen=True)
class ExportedRover:
    """Parameters, the name of the file they were read from, and what its first comments say."""

    parameters: PlantParameters
    source: str
    remarks: tuple[str, ...]

    @property
    def origin(self) -> list[str]:
        """Lines on where the numbers come from."""
        from rover_sweep._version import __version__

        first = f"Written by rover-sweep {__version__} with the numbers of {self.source}."
        return [line for words in (first, *self.remarks) for line in wrap(words, WIDTH)]


def rover_at(place: Path) -> ExportedRover:
    """Of a folder with a variant.toml (or its report/), a variant file, or a diagnosis.

    UsageError if there is none or its numbers cannot be used.
    """
    if place.is_file() and place.suffix.lower() == ".toml":
        return _read(place, place.name)
    if place.is_dir():
        for folder in (place, place / "report"):
            if (folder / "variant.toml").is_file():
                return _read(folder / "variant.toml", "variant.toml")
    return _diagnosed(place)


def rover_script(rover: ExportedRover, target: Path) -> str:
    """The rover as the source of the Python file `target`."""
    from sitl.twin.python_file import python_file

    if target.suffix != ".py" or not target.stem.isidentifier():
        raise UsageError(f"{target}: Python cannot import this name; give one such as rover_twin.py")
    return python_file(rover.parameters, rover.origin, target.stem)


def rover_fmu(rover: ExportedRover, target: Path) -> bytes:
    """The rover as the FMU file `target`; UsageError without pythonfmu."""
    from sitl.twin.fmu_file import can_build, fmu_file

    if target.suffix != ".fmu" or not target.stem.isidentifier():
        raise UsageError(f"{target}: not a name for an FMU; give letters, digits and _, as in rover_twin.fmu")
    if not can_build():
        raise missing_extra("--fmu needs pythonfmu", "fmu")
    try:
        return fmu_file(rover.parameters, rover.origin, target.stem)
    except RuntimeError as error:
        raise UsageError(str(error)) from error


def _diagnosed(place: Path) -> ExportedRover:
    from rover_sweep.api.simulate import diagnosis_file, read_augmented_model
    from rover_sweep.report.export.plant_variant import variant_text

    found = diagnosis_file(place)
    if found is None:
        raise UsageError(
            f"{place} holds no simulated rover; give the --out folder of diagnose, its diagnosis.json or the "
            ".toml file of a simulated rover"
        )
    model, _ = read_augmented_model(found)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "variant.toml"
        path.write_text(variant_text(model), encoding="utf-8")
        return _read(path, found.name)


def _read(path: Path, source: str) -> ExportedRover:
    """UsageError for numbers that are wrong one by one or together."""
    from sitl.plant.plant import Plant
    from sitl.plant.variant import load_variant

    try:
        parameters = load_variant(path.resolve())
        Plant(parameters)
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise UsageError(str(error)) from error
    remarks = takewhile(lambda line: line.startswith("#"), lines)
    return ExportedRover(parameters, source, tuple(line.lstrip("# ") for line in remarks))


_LIMITS = {"gcs": 1.0, "v_min": 1.0, "v_max": 5.0}
_PWM_MAX = 250.0  # us, default of SWP_PWM_MAX


@dataclass(frozen=True)
class SimulationOptions:
    """The options of a rover that is simulated."""

    physics: Physics = option(
        "Physics for the firmware: our plant, or the firmware's own rover. [default: plant]",
        click.Choice(("plant", "own")),
        default="plant",
    )
    ardurover: str | None = ARDUROVER
    variant: str = option(
        f"Simulated rover: physics; {', '.join(variants())}, or a TOML file. [default: nominal]",
        metavar="NAME|FILE",
        default="nominal",
    )
    seed: int = option(
        "Simulated rover: random seed of noise and road. [default: 1]", click.IntRange(min=0), default=1
    )
    rover_file: str | None = option("Simulated rover: vehicle file to use instead of the true one.", FILE)

    def rover(self, simulator: str) -> SimulatedRover:
        """The rover to start, with factory settings."""
        from rover_sweep.session.simulated_rover import SimulatedRover

        kind: Simulator = "ardurover" if simulator == "ardurover" else "embedded"
        binary = Path(self.ardurover) if self.ardurover else None
        return SimulatedRover(kind, binary, self.physics, self.variant, self.seed, prepared=False)


SIMULATION = gathered(SimulationOptions)


def refuse_on_simulated(connect: str | None, arm: bool, throttle: int | None) -> None:
    """UsageError for options that only make sense with an existing rover."""
    if connect:
        raise UsageError("--vehicle embedded or ardurover starts its own rover; remove --connect")
    if arm or throttle is not None:
        raise UsageError("a simulated rover is always armed and driven; remove --arm and --throttle")


def refuse_without_simulation(connect: str | None, simulation: SimulationOptions) -> None:
    """UsageError for options of a simulated rover without one, and for no rover at all."""
    if not connect:
        raise UsageError(
            "no rover: give --connect URL, or --vehicle embedded or ardurover for a simulated one"
        )
    for name, value in asdict(simulation).items():
        if value != _DEFAULTS.get(name):
            raise UsageError(f"--{name.replace('_', '-')} is for --vehicle embedded or ardurover")


def on_simulated(
    job: Job, simulator: str, out: str | None, options: SimulationOptions
) -> tuple[tuple[Vehicle, Path], SessionFinished, Numbers | None]:
    """Drive the job on a simulated rover; (vehicle and its file, session, view of the true parameters)."""
    from rover_sweep.cli.driving.session_display import show_session
    from rover_sweep.session.session import drive
    from rover_sweep.session.simulated_rover import pilot, started
    from rover_sweep.vehicle.link.recorded_transport import RecordedLine, conversation_in

    simulation = options.rover(simulator)
    plan = _plan(job, simulation)
    variant = None if options.physics == "own" else options.variant
    folder, rover = folder_with_rover(out, "run", options.rover_file, variant)
    announce(plan, folder)
    with ExitStack() as stack:
        running = stack.enter_context(started(simulation, folder / "vehicle"))
        line = stack.enter_context(RecordedLine(conversation_in(folder)))
        answer = None
        if plan.settings.trigger == "pilot":
            follow = stack.enter_context(pilot(running, simulation.throttle_us))

            def answer(_: PlainDisplay, event: Event) -> None:
                follow(event)

        session = show_session(
            drive(running.connection, folder, plan, line), folder, go_on=True, answer=answer
        )
    return rover, session, truth_view(variant) if variant is not None else None


def _plan(job: Job, simulation: SimulatedRover) -> SessionPlan:
    """The plan of the session; UsageError for values that the applet would refuse."""
    from firmware_params.applet_parameters import applet_path
    from firmware_params.param_files import read, shipped
    from rover_sweep.manoeuvre.sweep import parameters_of
    from rover_sweep.session.session import SessionPlan
    from rover_sweep.vehicle.run.controls import RunSettings

    trigger = job.trigger or "override"
    if trigger == "pilot" and simulation.simulator == "embedded":
        raise UsageError("the embedded rover has no radio for switch 6; use --throw-switch override or aux")
    highest = max(run.manoeuvre.peak for run in job.runs)
    extra = {"pwm_max": max(_PWM_MAX, highest), **_LIMITS, **job.limits}
    for run in job.runs:
        parameters_of(run.manoeuvre, **extra)
    throttle = None if trigger == "pilot" else simulation.throttle_us
    settings = RunSettings(True, throttle, trigger, extra)
    return SessionPlan(
        job.runs, settings, read(shipped("identification")), applet=applet_path(), logs=job.logs
    )
