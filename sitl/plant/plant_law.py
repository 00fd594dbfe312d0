"""Laws without a name, as tables of the variant file: what acts at a place, over one quantity of the motion.

    [[table_law]]
    place = "yaw moment"     # or another member of PLACES
    over = "r"               # or delta, a_y, p, phi, beta, v
    x = [-1.0, 0.0, 1.0]     # ascending
    y = [0.7, 0.0, -0.7]     # rad of the front wheels, N, or N m
    times = "a_y"            # optional factor: delta, a_y, r or v^2
    play = 0.02              # optional: x is the quantity behind a play of this half width

    [[table_law]]            # a hidden resonator that `over` drives: a load that swings, a linkage that gives
    place = "side force"
    over = "a_y"
    x = [0.0, 1.0]
    y = [0.3, 0.0]           # for 1 of its displacement u, and of u'/w with w = 2 pi frequency
    frequency = 1.4          # Hz: u'' + 2 damping w u' + w^2 u = w^2 over
    damping = 0.1

Linear between the points, constant beyond them. ISO axes, SI units: delta road-wheel angle, a_y lateral
acceleration at the roll axis, beta sideslip angle, v speed ahead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite

PLACES = ("steering", "side force front", "side force rear", "side force", "yaw moment", "roll moment")
OVER = ("delta", "a_y", "r", "p", "phi", "beta", "v")
FACTORS = ("", "delta", "a_y", "r", "v^2")
_KEYS = ("place", "over", "x", "y", "times", "play", "frequency", "damping")
_FASTEST = 20.0  # Hz, that the steps of the simulation resolve
_MOST, _LARGEST = 1000, 1e6  # points of a table; its numbers


@dataclass(frozen=True)
class PlantLaw:
    """One table, see the module."""

    place: str
    over: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    times: str = ""
    play: float = 0.0
    frequency: float = 0.0
    damping: float = 0.0


def table_laws(entries: object, where: str) -> tuple[PlantLaw, ...]:
    """The tables `[[table_law]]` of the file `where`; ValueError naming the wrong entry."""
    if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
        raise ValueError(f"variant {where}: table_law must be tables [[table_law]]")
    return tuple(_law(e, f"variant {where}: table_law") for e in entries)


def _law(entries: Mapping[str, object], place: str) -> PlantLaw:
    if unknown := [key for key in entries if key not in _KEYS]:
        raise ValueError(f"{place} has no {', '.join(unknown)}; it has {', '.join(_KEYS)}")
    if missing := [key for key in _KEYS[:4] if key not in entries]:
        raise ValueError(f"{place} lacks {', '.join(missing)}")
    times = entries.get("times", "")
    for key, value, allowed in (
        ("place", entries["place"], PLACES),
        ("over", entries["over"], OVER),
        ("times", times, FACTORS),
    ):
        if value not in allowed:
            raise ValueError(f"{place}: {key} = {value!r} must be one of {', '.join(filter(None, allowed))}")
    x, y = (_row(entries[key], f"{place}: {key}") for key in ("x", "y"))
    play = _finite(entries.get("play", 0.0), f"{place}: play")
    if len(x) != len(y) or any(b <= a for a, b in zip(x, x[1:], strict=False)) or play < 0.0:
        raise ValueError(f"{place}: x must ascend, have as many numbers as y, and play be 0 or more")
    frequency, damping = (_finite(entries.get(key, 0.0), f"{place}: {key}") for key in _KEYS[-2:])
    sound = 0.0 < frequency <= _FASTEST and damping > 0.0 and len(y) == 2 and not times and not play
    if (frequency or damping) and not sound:
        raise ValueError(
            f"{place}: a resonator needs a frequency up to {_FASTEST:g} Hz, a damping above 0, two y, and no "
            f"factor or play; it has {frequency:g} Hz, {damping:g} and {len(y)} y"
        )
    return PlantLaw(str(entries["place"]), str(entries["over"]), x, y, str(times), play, frequency, damping)


def _row(value: object, place: str) -> tuple[float, ...]:
    if not isinstance(value, list) or not 2 <= len(value) <= _MOST:
        raise ValueError(f"{place} must be a list of 2 to {_MOST} numbers")
    return tuple(_finite(v, place) for v in value)


def _finite(value: object, place: str) -> float:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not isfinite(value) or abs(value) > _LARGEST:  # type: ignore[arg-type]
        raise ValueError(f"{place} must have finite numbers up to {_LARGEST:g}")
    return float(value)  # type: ignore[arg-type]
