"""Parameter files with a reason on every line, and the differences of a vehicle from them."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

REBOOT = "[reboot]"  # in a reason: the value only counts after a restart
AT_LEAST = "[at least]"  # in a reason: a larger value will do as well
_SEPARATORS = re.compile(r"[,=\s]+")  # those of ArduPilot's AP_Param::parse_param_line


@dataclass(frozen=True)
class WantedParameter:
    """One line of a parameter file; at_least: a larger value on the vehicle is accepted."""

    name: str
    value: float
    reason: str = ""
    needs_reboot: bool = False
    at_least: bool = False

    def met_by(self, found: float | None) -> bool:
        """Whether the vehicle's value is accepted, compared as float32 as MAVLink carries it."""
        if found is None:
            return False
        wanted, has = _single(self.value), _single(found)
        return has == wanted or (self.at_least and has > wanted)


@dataclass(frozen=True)
class Difference:
    """A parameter with a wrong value; found is None if the vehicle does not have it."""

    name: str
    wanted: float
    found: float | None
    reason: str
    needs_reboot: bool
    sentence: str


def shipped(name: str = "identification") -> Path:
    """Path of a parameter file that comes with the project, by its name without `.param`."""
    folder = Path(__file__).parent
    path = folder / f"{name}.param"
    if not path.is_file():
        there = ", ".join(sorted(p.stem for p in folder.glob("*.param")))
        raise ValueError(f"there is no parameter file {name!r}; there are {there}")
    return path


def parse(text: str, source: str = "parameter file") -> tuple[WantedParameter, ...]:
    """Lines `NAME value` or `NAME,value`, with `# reason` behind; ArduPilot's own files can be read too.

    Raises ValueError with file and line number for a line that is neither a comment nor a parameter,
    and for a parameter that occurs twice.
    """
    wanted: dict[str, WantedParameter] = {}
    for number, line in enumerate(text.splitlines(), 1):
        entry, _, comment = line.partition("#")
        if not entry.strip():
            continue
        parameter = _parse_entry(entry, comment.strip(), f"{source}, line {number}")
        if parameter.name in wanted:
            raise ValueError(f"{source}, line {number}: {parameter.name} is there twice")
        wanted[parameter.name] = parameter
    return tuple(wanted.values())


def _parse_entry(entry: str, comment: str, where: str) -> WantedParameter:
    fields = _SEPARATORS.split(entry.strip().removesuffix("@READONLY").strip())
    try:
        name, value = fields
        number = float(int(value, 16)) if value.lower().startswith("0x") else float(value)
    except ValueError:
        raise ValueError(f"{where}: {entry.strip()!r} is not NAME value") from None
    reason = " ".join(comment.replace(REBOOT, "").replace(AT_LEAST, "").split())
    return WantedParameter(name.upper(), number, reason, REBOOT in comment, AT_LEAST in comment)


def read(path: Path) -> tuple[WantedParameter, ...]:
    """The parameters of a file; see `parse`."""
    return parse(path.read_text(encoding="utf-8"), path.name)


def compare(vehicle: Mapping[str, float], wanted: Iterable[WantedParameter]) -> tuple[Difference, ...]:
    """The parameters whose value on the vehicle (name -> value) is not accepted."""
    return tuple(
        _difference(parameter, vehicle.get(parameter.name))
        for parameter in wanted
        if not parameter.met_by(vehicle.get(parameter.name))
    )


def _single(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def _difference(parameter: WantedParameter, found: float | None) -> Difference:
    state = "does not exist on this vehicle" if found is None else f"is {found:.7g}"
    bound = "at least " if parameter.at_least else ""
    sentence = f"{parameter.name} {state}, wanted {bound}{parameter.value:.7g}"
    if parameter.reason:
        sentence += f": {parameter.reason}"
    if parameter.needs_reboot:
        sentence += " (counts after a reboot)"
    return Difference(
        parameter.name, parameter.value, found, parameter.reason, parameter.needs_reboot, sentence
    )
