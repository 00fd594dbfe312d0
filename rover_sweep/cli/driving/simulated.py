"""Simulated rovers: vehicle files, true parameters, export, and serving one to the firmware."""

from __future__ import annotations

import contextlib
import tempfile
import time
from dataclasses import dataclass, replace
from functools import partial
from itertools import takewhile
from math import radians, sin
from pathlib import Path
from textwrap import wrap

from firmware_params.param_files import shipped
from rover_sweep._version import __version__
from rover_sweep.api.save import result_file
from rover_sweep.api.simulate import diagnosis_file, read_augmented_model
from rover_sweep.cli.options import session_folder
from rover_sweep.cli.views.output import narration, results
from rover_sweep.data.results import number
from rover_sweep.data.vehicle_file import Vehicle, load
from rover_sweep.errors import LinkError, UsageError, missing_extra
from rover_sweep.identification.model_results import PHYSICAL
from rover_sweep.identification.pipeline import TITLES, Identification, usable
from rover_sweep.report.document import Cell, Table
from rover_sweep.report.export.plant_variant import variant_text
from rover_sweep.report.wording import change, symbol, unit
from sitl import launcher
from sitl.plant.effects.replaced_numbers import resolved
from sitl.plant.plant import Plant
from sitl.plant.variant import PlantParameters, load_variant
from sitl.rover_file import rover_file


def rover_text(variant: str) -> str:
    """rover.toml of a simulated rover: the values that an owner could measure."""
    try:
        return rover_file(load_variant(variant), variant)
    except ValueError as error:
        raise UsageError(str(error)) from error


def firmware_rover_text() -> str:
    """rover.toml of ArduPilot's own simulated rover (SIM_Rover.h, 4.6.3): 35 deg of steering at 500 us, and
    the wheelbase that follows from its turning circle of 1.8 m. It has no tyres and no body, so the masses
    (those of the nominal plant) do not affect the identified model."""
    half = 1.8 / 2 * sin(radians(35)) / 2
    own = replace(
        load_variant("nominal"),
        rad_per_us=round(radians(35) / 500, 6),
        cg_to_front_axle=round(half, 4),
        cg_to_rear_axle=round(half, 4),
    )
    return rover_file(own, "of the firmware")


def folder_with_rover(
    out: str | None, name: str, vehicle_file: str | None, variant: str | None
) -> tuple[Path, tuple[Vehicle, Path]]:
    """(a new session's folder, (vehicle, its file)): the given file, else one of the variant, in the folder.

    variant: None for the firmware's own rover. out, name: as in `session_folder`.
    """
    if vehicle_file:
        return session_folder(out, name), (load(vehicle_file), Path(vehicle_file))
    text = rover_text(variant) if variant is not None else firmware_rover_text()
    folder = session_folder(out, name, also=("rover.toml",))
    path = folder / "rover.toml"
    path.write_text(text, encoding="utf-8")
    return folder, (load(path), path)


def truth_table(variant: str, result: Identification) -> Table | None:
    """True and identified numbers, else the recommended physical model's parameters; None without any."""
    rover = resolved(load_variant(variant))
    models = usable(result)
    name = next((n for n in (result.recommended, *PHYSICAL) if n in models and n in PHYSICAL), None)
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
        first = f"Written by rover-sweep {__version__} with the numbers of {self.source}."
        return [line for words in (first, *self.remarks) for line in wrap(words, WIDTH)]


def rover_at(place: Path) -> ExportedRover:
    """The rover of a folder with a variant.toml (or its report/), a variant file, or a diagnosis.

    UsageError if there is none or its numbers cannot be used.
    """
    variant = result_file(place, "variant.toml")
    if variant is not None and variant.suffix.lower() == ".toml":
        return _read(variant, variant.name)
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


def _read(path: Path, source: str) -> ExportedRover:
    """UsageError for numbers that are wrong alone or in combination."""
    try:
        parameters = load_variant(path.resolve())
        Plant(parameters)
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise UsageError(str(error)) from error
    remarks = takewhile(lambda line: line.startswith("#"), lines)
    return ExportedRover(parameters, source, tuple(line.lstrip("# ") for line in remarks))


def serve_twin(place: Path, ardurover: Path | None, physics: bool, instance: int, seed: int) -> None:
    """Start the firmware with the variant as its physics, or the physics alone; wait for Ctrl-C.

    LinkError where the firmware does not start, or it or its physics ends early.
    """
    variant = place / "variant.toml" if place.is_dir() else place
    if not variant.is_file():
        raise UsageError(f"{place} has no variant.toml; give the folder that `rover-sweep twin` wrote")
    _read(variant, variant.name)
    tell = partial(narration().print, soft_wrap=True)
    if physics:
        from sitl.json_server import main

        command = f"ardurover --model JSON:127.0.0.1 --instance {instance}"
        tell(f"start the firmware with `{command}`; Ctrl-C ends this")
        main(["--variant", str(variant.resolve()), "--instance", str(instance), "--seed", str(seed)])
        return
    home = variant.parent / "served"
    try:
        running = launcher.start_ardurover(
            launcher.find_ardurover(ardurover),
            home,
            variant=variant.resolve(),
            seed=seed,
            instance=instance,
            defaults=[shipped("identification")],
        )
    except launcher.LaunchError as error:
        raise LinkError(f"{error}; --physics serves the JSON interface alone") from error
    with running:
        results().print(running.connection)
        tell(
            f"the twin is served: connect a ground station to {running.connection}; its logs are in {home}; "
            "Ctrl-C ends it"
        )
        with contextlib.suppress(KeyboardInterrupt):
            while not (words := running.last_words()):
                time.sleep(1.0)
            raise LinkError(f"the simulated rover ended: {words}")
