"""Options of commands, each declared once; their types, and those that several commands share."""

from __future__ import annotations

import functools
import math
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from inspect import Parameter, signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.views.output import echo
from rover_sweep.data.recording import OUTPUTS
from rover_sweep.data.vehicle_file import Measured
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rover_sweep.api.read import Reading

# A command's options are the defaults of its parameters.


FILE, FOLDER = click.Path(dir_okay=False), click.Path(file_okay=False)


@dataclass(frozen=True, eq=False)
class _Declared:
    """declare: makes the decorator of click from the parameter's name, and whether it is a bool."""

    declare: Callable[[str, bool], Callable[..., Any]]


@dataclass(frozen=True, eq=False)
class _Together:
    make: Callable[..., Any]
    instead: Mapping[str, Any]


def option(
    help: str | None, type: Any = None, metavar: str | None = None, flag: str = "", **more: Any
) -> Any:
    """An option, as the default of a parameter of a command with `options`; a bool is a flag.

    flag: its names, "-o --output"; by default the parameter's. metavar: DIR for a FOLDER. Shows the default
    unless the help has "[default: ...]". more: of click.option.
    """
    shown = more.get("default") not in (None, "", ()) and "[default" not in (help or "")
    metavar = metavar or ("DIR" if type is FOLDER else None)
    settings: dict[str, Any] = {"type": type, "metavar": metavar, "help": help, "show_default": shown} | more

    def declare(name: str, is_flag: bool) -> Callable[..., Any]:
        names = flag.split() or [f"--{name.replace('_', '-')}"]
        if is_flag:
            return click.option(*names, name, is_flag=True, help=help, **more)
        return click.option(*names, name, **settings)

    return _Declared(declare)


def argument(metavar: str | None = None, **settings: Any) -> Any:
    """An argument, as the default of a parameter; settings: of click.argument."""
    return _Declared(lambda name, _: click.argument(name, metavar=metavar, **settings))


def gathered(make: Callable[..., Any], **instead: Any) -> Any:
    """Calls `make` (a dataclass) with options; the default of each of its parameters declares its option.

    A parameter without a default takes the command's own option of that name. instead: replaces the option of
    a parameter, by another or by a fixed value.
    """
    return _Together(make, instead)


def options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Gives the function the options that are the defaults of its parameters, in their order."""
    whole = gathered(command)

    @functools.wraps(command)
    def filled(**given: Any) -> Any:
        return _made(whole, given)

    for parameter in reversed(list(_declared(whole))):
        filled = parameter.default.declare(parameter.name, parameter.annotation == "bool")(filled)
    return filled


def _parameters(of: _Together) -> Iterator[Parameter]:
    for name, parameter in signature(of.make).parameters.items():
        yield parameter.replace(default=of.instead.get(name, parameter.default))


def _declared(of: _Together) -> Iterator[Parameter]:
    for parameter in _parameters(of):
        if isinstance(parameter.default, _Together):
            yield from _declared(parameter.default)
        elif isinstance(parameter.default, _Declared):
            yield parameter


def _made(of: _Together, given: dict[str, Any]) -> Any:
    given = given | {n: v for n, v in of.instead.items() if not isinstance(v, _Declared | _Together)}
    made = {p.name: _made(p.default, given) for p in _parameters(of) if isinstance(p.default, _Together)}
    return of.make(**{p.name: made[p.name] if p.name in made else given[p.name] for p in _parameters(of)})


class Grouped(click.Command):
    """A command whose help shows its options in groups: {heading: names of parameters}.

    Options that no group names come last.
    """

    def __init__(self, *given: Any, groups: Mapping[str, str], **more: Any) -> None:
        super().__init__(*given, **more)
        self.groups = groups

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        named = {name: heading for heading, names in self.groups.items() for name in names.split()}
        shown: dict[str, list[tuple[str, str]]] = {heading: [] for heading in (*self.groups, "Rarely needed")}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx) if isinstance(parameter, click.Option) else None
            if record:
                shown[named.get(parameter.name or "", "Rarely needed")].append(record)
        for heading, records in shown.items():
            with formatter.section(heading):
                formatter.write_dl(records)


class Parsed(click.ParamType):
    """An option's text, converted by a function; its ValueError is the usage error."""

    def __init__(self, name: str, make: Callable[[str], Any]) -> None:
        self.name, self._make = name, make

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The value; a default that is not text is kept."""
        if not isinstance(value, str):
            return value
        try:
            return self._make(value)
        except ValueError as error:
            self.fail(str(error), param, ctx)


def finite(text: str, wrong: str) -> float:
    """The number; ValueError with the words `wrong` for anything else."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(wrong)
    return number


def _band(text: str) -> tuple[str, tuple[float, float]]:
    """(response, (low, high))."""
    name, _, limits = text.partition("=")
    low, high = (finite(x, f"{text!r} is not a band such as p=0.6:20 (rad/s)") for x in limits.split(":", 1))
    if name not in OUTPUTS or not 0 < low < high:
        raise ValueError(f"{text!r}: use one of {', '.join(OUTPUTS)} and 0 < low < high in rad/s")
    return name, (low, high)


BAND = Parsed("RESPONSE=LOW:HIGH", _band)


class NumberRange(click.FloatRange):
    """A finite number within bounds; click lets NaN pass any bound, and infinity an open end."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number", param, ctx)
        return number


POSITIVE = NumberRange(0, min_open=True)


def numbers_type(what: str = "numbers", unit: str = "", below: float = math.inf) -> Parsed:
    """Positive numbers below a limit, separated by commas or blanks, e.g. 5,8,12,18,27."""
    within = f" in {unit}" if unit else ""

    def numbers(text: str) -> tuple[float, ...]:
        wrong = f"{text!r} is not a list of {what}{within} such as 47.5,47.3,47.6"
        try:
            found = tuple(float(part) for part in re.split(r"[,\s]+", text.strip()))
        except ValueError:
            raise ValueError(wrong) from None
        if not all(0 < n < below for n in found):
            most = f" and below {below:g}" if math.isfinite(below) else " and finite"
            raise ValueError(f"{text!r}: every number must be positive{most}{within}")
        return found

    return Parsed(f"{unit.upper() or 'N'},{unit.upper() or 'N'},...", numbers)


def names_type(name: str = "NAME,NAME,...", allowed: tuple[str, ...] = ()) -> Parsed:
    """Names joined by commas, of `allowed` if there are any; else the command checks that they exist."""

    def names(text: str) -> tuple[str, ...]:
        found = tuple(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))
        if not found:
            raise ValueError(f"{text!r} contains no name; give a name or remove the option")
        if wrong := [n for n in found if allowed and n not in allowed]:
            raise ValueError(f"there is no {wrong[0]!r}; choose from {', '.join(allowed)}")
        return found

    return Parsed(name, names)


EFFECTS = names_type("ID,ID,...")


VEHICLE = option("Vehicle file (default: the session's, or rover.toml here).", FILE, flag="--vehicle")
REPORT = option("Folder of the report; created if missing.", FOLDER, required=True)
FULL = option(
    "Show all tables: every model, costs, verification, handling, steps of the reduction.",
    flag="--full --verbose",
)
AS_JSON = option("Print identification.json on stdout; tables go to stderr.", flag="--json")
SESSION = argument(type=click.Path(exists=True, file_okay=False, path_type=Path))
OUTPUT = option("File to write. [default: stdout]", metavar="FILE", flag="-o --output", default="-")
SEED = option("Random seed of noise and road.", click.IntRange(0), default=1)


RATE = option("Rate of the rows of a file without a clock.", NumberRange(0.1), "HZ")


def with_rate(columns: str | None, rate: float | None) -> str | Mapping[str, Any] | None:
    """The column map to read with: that of a file, whose clock is replaced by even samples at a rate [Hz]."""
    if rate is None:
        return columns
    from rover_sweep.logs.readers.column_map import read_column_map

    return {**(read_column_map(columns) if columns else {}), "time": {"rate": rate}}


def _reading(
    columns: str | None = option("Column map of other systems' files (TOML; see `columns`).", FILE),
    rate: float | None = RATE,
    system: int | None = option(
        "MAVLink system id of the vehicle, if a .tlog contains several.", click.IntRange(1, 255), "N"
    ),
    gyro_filter: float | None = option(
        "INS_GYRO_FILTER during the drive, if the log lacks it (0: off).", NumberRange(0), "HZ"
    ),
    accel_filter: float | None = option(
        "INS_ACCEL_FILTER during the drive, if the log lacks it (0: off).", NumberRange(0), "HZ"
    ),
    servo_telemetry: bool = option(
        "Take the measured position of the servo (CSRV) as the steering: the rover without its servo."
    ),
) -> Reading:
    from rover_sweep.api.read import Reading

    filters = {"gyro_hz": gyro_filter, "accel_hz": accel_filter}
    kept = {k: v for k, v in filters.items() if v is not None} or None
    return Reading(with_rate(columns, rate), kept, system, servo_telemetry, _words(columns, rate))


def _words(columns: str | None, rate: float | None) -> tuple[str, ...]:
    even = () if rate is None else ("--rate", f"{rate:g}")
    return (*(("--columns", columns) if columns else ()), *even)


READING = gathered(_reading)


def found_vehicle(given: str | None, runs: Sequence[str] = ()) -> str | None:
    """The vehicle file: as given, else that of a session among the runs, else rover.toml here, else None.

    UsageError where a run does not exist.
    """
    from rover_sweep.api.read import refuse_missing
    from rover_sweep.session.folder import VEHICLE_FILE, kept_vehicle_file

    kept = given or kept_vehicle_file(runs)
    if not kept and not Path(VEHICLE_FILE).is_file():
        refuse_missing(runs)
        return None
    return str(kept or VEHICLE_FILE)


def vehicle_path(given: str | None, runs: Sequence[str] = ()) -> str:
    """The vehicle file as `found_vehicle` finds it; UsageError without one."""
    if found := found_vehicle(given, runs):
        return found
    raise UsageError(
        "no vehicle file: give --vehicle rover.toml; create one with "
        "`rover-sweep vehicle --example > rover.toml`"
    )


def measured_type(low: float, high: float, unit: str, hint: str) -> Parsed:
    """A positive number, with its standard deviation after +- or ±, e.g. 1.200+-0.003."""

    def measured(text: str) -> Measured:
        wrong = f"{text!r} is not a number such as 1.2 or 1.2+-0.01 ({unit})"
        numbers = [finite(part, wrong) for part in re.split(r"\+-|\+/-|±", text)]
        if len(numbers) > 2 or not low <= numbers[0] <= high:
            raise ValueError(f"{text!r} is outside {low:g}..{high:g} {unit}; {hint}")
        if len(numbers) == 2 and not 0 <= numbers[1] < numbers[0]:
            raise ValueError(f"{text!r}: the uncertainty must be between 0 and the number, in {unit}")
        return Measured(numbers[0], numbers[1] if len(numbers) == 2 else None)

    return Parsed("NUMBER[+-SD]", measured)


READ_IN_FOLDERS = ("identification.json", "speed.json", "diagnosis.json", "session.json", "rover.toml")


def refuse_no_folder(output: str) -> None:
    """UsageError if the file's folder does not exist; a mistyped folder is not created."""
    folder = Path(output).parent
    if output != "-" and not folder.is_dir():
        raise UsageError(f"cannot write {output}: there is no folder {folder}; create it, or give another")


def refuse_input(output: str, *inputs: str | Path | None) -> None:
    """UsageError if the file is one of the inputs, or is read from an input folder."""
    path = Path(output).resolve()
    for given in (Path(given).resolve() for given in inputs if given is not None):
        if path == given or (path.parent == given and path.name in READ_IN_FOLDERS):
            raise UsageError(f"{output} is an input of this command; give another name to write to")


def write_text(output: str, text: str, report: str = "written") -> None:
    """Write the text; for a file, print its name and `report` on stderr."""
    if output == "-":
        echo(text, nl=False)
        return
    from rover_sweep.files.documents import write_file

    refuse_no_folder(output)
    write_file(Path(output), text)
    echo(f"{output}: {report}", err=True)


_SESSION = ("session.json", "*.tlog", "*.BIN", "report")


def check_writable(folder: Path) -> None:
    """UsageError if `folder` is not writable; leaves nothing behind."""
    try:
        made = [p for p in (folder, *folder.parents) if not p.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        for path in made:
            path.rmdir()
    except OSError as error:
        raise UsageError(f"{folder} cannot be written: {error.strerror}; give another --out") from error


def check_report_folder(folder: Path, documents: tuple[str, ...], written: tuple[str, ...]) -> None:
    """UsageError if `folder` is not writable, or if a report would replace files that no report wrote.

    documents: names of the files that a report always has. written: glob patterns of the others.
    """
    ours = any((folder / name).is_file() for name in documents)
    if not ours and (held := _held(folder, written)):
        raise UsageError(
            f"{folder} has {held} but no {documents[0]}: this program did not write it; give another --out"
        )
    check_writable(folder)


def session_folder(given: str | None, name: str, also: tuple[str, ...] = ()) -> Path:
    """Create an empty folder for a session: `given`, else the first free of `name`, `name`-2, ...

    also: glob patterns of further files that must not exist. UsageError if the given folder contains a
    session, or is not writable.
    """
    from rover_sweep.files.documents import numbered

    if given is None:
        folder = next(p for p in numbered(Path(name)) if not p.exists())
    else:
        folder = Path(given)
        if held := _held(folder, (*_SESSION, *also)):
            raise UsageError(
                f"{folder} already contains a session ({held}); continue it with `rover-sweep resume`, or "
                "give another --out"
            )
    check_writable(folder)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _held(folder: Path, patterns: tuple[str, ...]) -> str | None:
    """Name of the first file in the folder that matches."""
    if not folder.is_dir():
        return None
    found = (path for pattern in patterns for path in sorted(folder.glob(pattern)))
    return next((str(path.relative_to(folder)) for path in found), None)


def _ground(text: str) -> tuple[float, float]:
    """(length, width) [m]; the length is in the direction of the drive."""
    found = re.fullmatch(r"([0-9]+\.?[0-9]*)x([0-9]+\.?[0-9]*)", text.strip())
    if not found or not (0 < float(found[1]) <= 1e5 and 0 < float(found[2]) <= 1e5):
        raise ValueError(f"{text!r} is not a ground; write it as 60x20, length and width in m")
    return float(found[1]), float(found[2])


GROUND = Parsed("LENGTHxWIDTH", _ground)
