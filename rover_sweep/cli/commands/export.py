"""`rover-sweep export`: write a model for python-control, MATLAB, any JSON reader, or the simulation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rover_sweep.cli.options import (
    OUTPUT,
    NumberRange,
    argument,
    option,
    options,
    refuse_input,
    refuse_no_folder,
)
from rover_sweep.cli.views.output import echo, say_next
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.files.documents import printable_lines, read_json

FORMATS = {".json": "json", ".m": "matlab", ".py": "python", ".mat": "mat"}
JUDGED_GOOD = ("good", "acceptable", "none", "explained")


@click.command(short_help="Export a model for MATLAB, python-control, the simulated rover, or as JSON.")
@options
def export(
    place: str = argument("DIR|FILE", type=click.Path()),
    model: str | None = option(
        "bicycle, roll-yaw, lumped or kinematic. [default: the recommended one]", metavar="NAME"
    ),
    format: str | None = option(
        "Output format. [default: from the suffix of FILE; json without FILE]",
        click.Choice(["json", "matlab", "python", "mat"]),
    ),
    speed: float | None = option(
        "Speed of the model, if not that of the runs (not for the lumped model).", NumberRange(0.1, 50), "M/S"
    ),
    plant: bool = option("Export the model of a diagnosis as a simulated rover, for --variant."),
    python: str | None = option(
        "Write the simulated rover as one Python file that does not need rover-sweep.", metavar="FILE.py"
    ),
    fmu: str | None = option(
        "Write the simulated rover as an FMU (FMI 2.0 co-simulation). Needs pythonfmu.", metavar="FILE.fmu"
    ),
    output: str = OUTPUT,
) -> None:
    """Export a model from DIR, the report folder of `identify` or `diagnose`, or from a diagnosis.json.

    From a diagnosis, exports the linear part of the model and describes the rest. --plant, --python and
    --fmu export all of it, nonlinear; the last two also take any FILE.toml of a simulated rover.

    Writes continuous-time A, B, C, D (and M, F, G, H0, H1), names and units of states, input and outputs,
    and the input delay tau. The sensors' low-pass filters are listed separately: they are not part of the
    rover. The python file computes responses with numpy alone; its system() needs `pip install control`.
    """
    from rover_sweep.api.simulate import diagnosis_file, exported, read_augmented_model
    from rover_sweep.report.export import exported_model
    from rover_sweep.report.export.plant_variant import variant_text

    path, other = Path(place), (model, format, speed)
    for written in (output, python, fmu):
        if written not in ("-", None):
            refuse_input(str(written), place)
    if python is not None or fmu is not None:
        from rover_sweep.cli.driving.simulated import rover_at, rover_fmu, rover_script

        if any(given is not None for given in other) or plant or output != "-":
            raise UsageError(
                "--python and --fmu write the whole rover; remove --model, --format, --speed, --plant and -o"
            )
        rover = rover_at(path)
        if python is not None:
            _write(python, rover_script(rover, Path(python)), f"simulated rover of {rover.source}")
        if fmu is not None:
            _write(fmu, rover_fmu(rover, Path(fmu)), f"FMU of {rover.source}")
        return
    found = diagnosis_file(path)
    if plant:
        if any(given is not None for given in other):
            raise UsageError("--plant always writes TOML for any speed; remove --model, --format and --speed")
        if output != "-" and Path(output).suffix.lower() != ".toml":
            raise UsageError(f"{output}: a simulated rover is a TOML file; give a name that ends in .toml")
        if found is None:
            raise UsageError(
                f"{place} holds no diagnosis; give the --out folder of diagnose or its diagnosis.json"
            )
        diagnosed, _ = read_augmented_model(found)
        _write(output, variant_text(diagnosed), f"{diagnosed.name} model as a simulated rover")
        if output != "-":
            say_next(f"rover-sweep dry-run --variant {output}")
        return
    inside = path / "report"  # of the folder of a session
    here = (path / "identification.json").is_file()
    folder = inside if not here and (inside / "identification.json").is_file() else path
    if found is not None and not (folder / "identification.json").is_file():
        document = exported(found, model, speed)
    elif path.is_file():
        raise UsageError(f"{place} is not a diagnosis.json; for a model of `identify` give its report folder")
    else:
        document = _load(folder, model)
        document = document if speed is None else _moved(document, speed)
    match format or _by_suffix(output):
        case "matlab":
            content: str | bytes = exported_model.matlab_text(document)
        case "python":
            content = exported_model.python_text(document)
        case "mat":
            content = exported_model.mat_file(document)
        case _:
            content = exported_model.json_text(document)
    if isinstance(content, bytes) and output == "-":
        raise UsageError("a .mat file is binary and cannot go to stdout; give a file with -o FILE.mat")
    _write(output, content, f"{document['model']} model at {document['speed_m_s']:.3g} m/s")
    if output != "-" and document["verdict"] not in JUDGED_GOOD:
        judged = "diagnosis" if document.get("augmented") else "fit"
        echo(f"warning: the verdict of this {judged} is: {document['verdict']}", err=True)


def _write(output: str, content: str | bytes, what: str) -> None:
    """Write to stdout (text only) or into a file; for a file, `what` is reported on stderr."""
    from rover_sweep.files.documents import write_file

    if output == "-":
        click.echo(printable_lines(content) if isinstance(content, str) else content, nl=False)
        return
    refuse_no_folder(output)
    write_file(Path(output), content)
    echo(f"{what} written to {output}", err=True)


def _by_suffix(output: str) -> str:
    suffix = Path(output).suffix.lower()
    if output != "-" and suffix not in FORMATS:
        ending = suffix or "no suffix"
        raise UsageError(
            f"{output}: no format is known for {ending}; give --format, or use .json, .m, .mat or .py"
        )
    return FORMATS.get(suffix, "json")


def _load(directory: Path, name: str | None) -> dict[str, Any]:
    missing = f"{directory} holds no report; give the --out folder of identify, run or dry-run"
    document = _read(directory / "identification.json", missing)
    wanted = name or document.get("recommended")
    available = sorted(p.stem for p in (directory / "models").glob("*.json"))
    if wanted is None:
        raise DataRefused(
            f"{directory}: no model is recommended; choose one with --model {'|'.join(available)}"
        )
    if wanted not in available:
        raise _absent(directory, wanted, available, document)
    return _read(directory / "models" / f"{wanted}.json", f"{wanted}.json cannot be read; run identify again")


def _absent(directory: Path, wanted: str, available: list[str], document: dict[str, Any]) -> Exception:
    """The error for a model that the report lacks: refused, rejected, or not requested."""
    reasons = dict(document.get("refused", {}))
    for model, entry in document.get("models", {}).items():
        reasons.setdefault(model, "; ".join(entry.get("verdict", {}).get("sentences", [])[:1]))
    if reasons.get(wanted):
        return DataRefused(f"there is no {wanted} model to export: {reasons[wanted]}")
    return UsageError(f"{directory} holds no model {wanted!r}; there are {', '.join(available) or 'none'}")


def _read(path: Path, missing: str) -> dict[str, Any]:
    try:
        content = read_json(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(missing) from error
    except ValueError as error:
        raise DataRefused(f"{path} is damaged ({error}); run identify again") from error
    if not isinstance(content, dict):
        raise DataRefused(f"{path} is not a file of rover-sweep; run identify again")
    return content


def _moved(model: dict[str, Any], speed: float) -> dict[str, Any]:
    from rover_sweep.report.export.exported_model import at_speed

    if model["model"] == "lumped":
        speed_text = f"{model['speed_m_s']:.3g} m/s"
        raise UsageError(
            f"the lumped model is valid only at {speed_text}; use the roll-yaw or bicycle model with --speed"
        )
    return at_speed(model, speed)
