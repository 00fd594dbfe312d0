"""Text forms of numbers, parameter names and units."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import math
import platform
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rover_sweep._version import __version__
from rover_sweep.data.recording import Recording
from rover_sweep.data.results import number
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.files.documents import within_json

if TYPE_CHECKING:
    from rover_sweep.diagnosis.result import Unseen, UpperBound

OUTPUT_NAMES = {
    "r": "yaw rate r",
    "ay": "lateral acceleration a_y",
    "vydot": "lateral velocity rate vydot",
    "p": "roll rate p",
    "vy": "lateral velocity V_y",
}
SHORT_NAMES = {"r": "r", "ay": "a_y", "vydot": "vydot", "p": "p"}
SYMBOLS = {
    "C": "Cf = Cr",
    "tau": "τ",
    "k_phi": "k_φ",
    "b_phi": "b_φ",
    "Izz": "I_zz",
    "Ixx": "I_xx",
    "Ixz": "I_xz",
    "ms": "m_s",
    "V": "V_x",
}


def percent(value: float | None) -> str:
    """A percentage with three significant digits, without its sign %."""
    if value is None or not math.isfinite(value):
        return "–"
    return "> 1000" if value >= 1000 else number(value, 3)


def change(value: float | None) -> str:
    """A change in percent with its sign, to a tenth."""
    if value is None or not math.isfinite(value):
        return "–"
    return "> +1000" if value >= 1000 else f"{round(value, 1) + 0.0:+.1f}"  # + 0.0: no -0.0


def band(limits: tuple[float, float] | None) -> str:
    """A frequency band in rad/s, – for none."""
    return f"{limits[0]:.2g}–{limits[1]:.3g}" if limits else "–"


def symbol(parameter: str) -> str:
    """A parameter as the paper writes it."""
    if parameter in SYMBOLS:
        return SYMBOLS[parameter]
    return parameter.replace("_phi", "_φ").replace("_delta", "_δ")


def unit(text: str) -> str:
    """A unit with its exponents raised."""
    return text.replace("^2", "²")


# Units in which a report shows accelerations: SI, or the paper's ft/s². Angles are in deg in both.


FOOT = 0.3048  # m


@dataclass(frozen=True)
class ShownUnits:
    """name: as an option; acceleration: its unit; per_si: number of them in 1 m/s²."""

    name: str
    acceleration: str
    per_si: float

    def words(self, text: str) -> str:
        """A label or unit with the shown unit of acceleration in place of m/s²."""
        return text.replace("m/s²", self.acceleration).replace("m/s^2", self.acceleration)

    def factor(self, unit: str) -> float:
        """Factor for a number in an SI unit, such as "m/s^2 per rad"."""
        return self.per_si if unit.replace("²", "^2").startswith("m/s^2") else 1.0

    def db(self, unit: str) -> float:
        """Offset [dB] of a magnitude in an SI unit."""
        return float(20 * np.log10(self.factor(unit)))


SI = ShownUnits("SI", "m/s²", 1.0)
PAPER = ShownUnits("paper", "ft/s²", 1 / FOOT)
SHOWN_UNITS = {units.name: units for units in (SI, PAPER)}


# Provenance of a report: vehicle file, verification runs, command, versions.


def versions() -> dict[str, str]:
    """Versions of the packages that computed the numbers."""
    packages = {name: importlib.metadata.version(name) for name in ("numpy", "scipy")}
    return {"rover_sweep": __version__, **packages, "python": platform.python_version()}


@dataclass(frozen=True, eq=False)
class Provenance:
    """Origin of a result.

    vehicle: the rover as in its file; vehicle_source: (name, sha256) of that file.
    verify_runs: the recordings of the verification, in the order of the identification's verdicts.
    command: the command line; made: when, ISO 8601, "" to leave it out.
    """

    vehicle: Vehicle | None = None
    vehicle_source: tuple[str, str] | None = None
    verify_runs: tuple[Recording, ...] = ()
    command: str = ""
    made: str = ""
    versions: dict[str, str] = field(default_factory=versions)


def provenance(
    vehicle: Vehicle | None = None,
    vehicle_file: Path | None = None,
    verify_runs: Sequence[Recording] = (),
    command: str = "",
    now: datetime | None = None,
) -> Provenance:
    """A Provenance; reads the vehicle file for its hash. now: time of the report, with time zone."""
    source = None
    if vehicle_file is not None:
        source = vehicle_file.name, hashlib.sha256(vehicle_file.read_bytes()).hexdigest()
    made = now.isoformat(timespec="seconds") if now else ""
    return Provenance(vehicle, source, tuple(verify_runs), command, made)


def versions_words(found: Mapping[str, str]) -> str:
    """The packages with their versions."""
    return ", ".join(f"{name} {version}" for name, version in found.items())


def count(n: int, what: str) -> str:
    """ "1 run", "2 runs"."""
    return f"{n} {what}{'s' if n != 1 else ''}"


# JSON that every reader accepts: no NaN, no Infinity, keys in insertion order.


def plain(value: Any) -> Any:
    """The value in plain JSON types; numbers that are not finite become None. TypeError for other types."""
    match value:
        case None | bool() | str():
            return value
        case np.ndarray() | np.generic():
            return plain(value.tolist())
        case int():
            return int(value)
        case float():
            return float(value) if math.isfinite(value) else None
        case Mapping():
            return {str(key): plain(item) for key, item in value.items()}
        case list() | tuple():
            return [plain(item) for item in value]
    raise TypeError(f"{type(value).__name__} cannot be written as JSON: {value!r}")


def strict_json(value: Any) -> str:
    """Indented strict JSON, lists of numbers and of short words on one line, with a newline at the end."""
    return within_json(_text(plain(value), 0)) + "\n"


def _text(value: Any, depth: int) -> str:
    inner, outer = "  " * (depth + 1), "  " * depth
    if isinstance(value, dict) and value:
        items = (f"{inner}{json.dumps(key)}: {_text(item, depth + 1)}" for key, item in value.items())
        return "{\n" + ",\n".join(items) + f"\n{outer}}}"
    if isinstance(value, list) and any(
        isinstance(item, dict | list) or len(str(item)) > 30 for item in value
    ):
        return "[\n" + ",\n".join(inner + _text(item, depth + 1) for item in value) + f"\n{outer}]"
    return json.dumps(value, allow_nan=False, ensure_ascii=False)


# Names of effects and channels in texts; the ids are for programs.


CHANNELS = {**SHORT_NAMES, "vy": "V_y"}


def title(effect: str) -> str:
    """The effect's name in words, from its id if unknown."""
    from rover_sweep.diagnosis.effects import library  # loads the compiler

    known = library().get(effect)
    return known.title if known else effect.replace("_", " ")


def channel(name: str) -> str:
    """A response as it is written in tables."""
    return CHANNELS.get(name, name)


def capital(text: str) -> str:
    """The text with a capital first letter, unless it starts with a name such as a_y, r or run1."""
    return text[:1].upper() + text[1:] if re.match(r"(a |[a-z]{2,}\b(?![_\d]))", text) else text


def sentence(text: str) -> str:
    """The text with a capital letter and a full stop."""
    text = capital(text.strip())
    return text if not text or text[-1] in ".!?" else f"{text}."


# What could still hide in the runs of a diagnosis, in words.


EVEN = 0.03  # relative difference of both ends of a range up to which they count as equal


def range_words(bound: UpperBound) -> str:
    """The range that is not excluded, without its unit."""

    def short(value: float) -> str:
        """Two digits, three from 1 to 2, where a ratio has its values."""
        return number(value, 3 if 1.0 <= abs(value) < 2.0 else 2)

    low, high = bound.low, bound.high
    if low is not None and high is not None and low < 0.0:
        if abs(low + high) <= EVEN * (high - low):
            return f"\N{PLUS-MINUS SIGN}{short(max(high, -low))}"
        return f"{short(low)} to {short(high)}"
    if high is None:
        return "any" if low is None else f"at least {short(low)}"
    return f"up to {short(high)}" if not low else f"{short(low)} to {short(high)}"


def hiding_words(unseen: Sequence[Unseen]) -> str:
    """The effects that matter most among those that could still hide, in one sentence; "" for none."""
    from rover_sweep.diagnosis.result import largest_hidden

    words = []
    for u in largest_hidden(unseen):
        parts = []
        for name, bound in u.up_to.items():
            named = f"{name} " if len(u.up_to) > 1 else ""
            of = "" if bound.unit == "-" else unit(bound.unit)
            parts.append(f"{named}{range_words(bound)} {of}".rstrip())
        words.append(f"{title(u.effect)} ({', '.join(parts)})")
    return ", ".join(words)
