"""The embedded rover's parameters: typed, float32 on the wire, kept in a file over reboots.

ArduPilot's rules as far as a ground station can see them: an unknown name is ignored; integers are cut
with 0.01 added (AP_Param::set_float); what a group's enable switch turns off is not listed; a script's
parameter can be read by name at once, but reaches the list with the next boot after it was first added.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from sitl.autopilot.parameter_defaults import Kind, parameter_table

MAV_PARAM_TYPE = {"int8": 2, "int16": 4, "int32": 6, "float": 9}
INT_RANGE = {"int8": (-128, 127), "int16": (-32768, 32767), "int32": (-(2**31), 2**31 - 1)}
NAME_LENGTH = 16
NOT_SAVED = frozenset({"SIM_RC_FAIL"})


@dataclass
class Parameter:
    """name, its value now and by default, both as the vehicle stores them; listed: in a list request."""

    name: str
    kind: Kind
    value: float
    default: float
    listed: bool = True


def stored(value: float, kind: Kind) -> float:
    """The stored form of a value: float32; integers cut towards zero after +-.01."""
    single = float(struct.unpack("<f", struct.pack("<f", value))[0])
    if kind == "float":
        return single
    low, high = INT_RANGE[kind]
    return float(int(min(max(single, low), high) + math.copysign(0.01, single)))


class ParameterStore:
    """All parameters of one vehicle. `file` holds what differs from the defaults, one "NAME value" a line."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.on_change: list[Callable[[Parameter], None]] = []
        self._saved = read_saved(file)
        self._all: dict[str, Parameter] = {}
        for name, default, kind in parameter_table():
            value = stored(self._saved.get(name, default), kind)
            self._all[name] = Parameter(name, kind, value, stored(default, kind))

    def __contains__(self, name: str) -> bool:
        return name in self._all

    def __getitem__(self, name: str) -> float:
        return self._all[name].value

    def find(self, name: str) -> Parameter | None:
        """The parameter of that name, listed or not; None for an unknown name."""
        return self._all.get(name)

    def listed(self) -> list[Parameter]:
        """Parameters of a list request in order; the position is the parameter's index."""
        scripting = self["SCR_ENABLE"] != 0
        return [p for p in self._all.values() if p.listed and (scripting or not _scripting_detail(p.name))]

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self._all.values())

    def set(self, name: str, value: float, save: bool = True) -> Parameter | None:
        """Sets a parameter as PARAM_SET does; None where the name is unknown or the value no number."""
        parameter = self._all.get(name)
        if parameter is None or not math.isfinite(value):
            return None
        parameter.value = stored(value, parameter.kind)
        if save and name not in NOT_SAVED:
            self._saved[name] = parameter.value
            self._write()
        for tell in self.on_change:
            tell(parameter)
        return parameter

    def add(self, name: str, default: float) -> bool:
        """A script's own parameter; one that exists keeps its value. False for a name that cannot be."""
        if not name or len(name) > NAME_LENGTH:
            return False
        if name in self._all:
            return True
        known = name in self._saved
        value = self._saved.get(name, default)
        self._all[name] = Parameter(name, "float", stored(value, "float"), stored(default, "float"), known)
        if not known:
            self._saved[name] = stored(default, "float")
            self._write()
        return True

    def _write(self) -> None:
        text = "".join(f"{name} {value!r}\n" for name, value in sorted(self._saved.items()))
        partial = self.file.with_suffix(".new")
        partial.write_text(text, encoding="ascii")
        partial.replace(self.file)


def _scripting_detail(name: str) -> bool:
    return name.startswith("SCR_") and name != "SCR_ENABLE"


def read_saved(file: Path) -> dict[str, float]:
    """The saved values; {} without a file. Raises ValueError naming a line that is not "NAME value"."""
    values: dict[str, float] = {}
    if not file.exists():
        return values
    for number, line in enumerate(file.read_text(encoding="ascii").splitlines(), 1):
        try:
            name, value = line.split()
            values[name] = float(value)
        except ValueError:
            raise ValueError(
                f"{file}, line {number}: '{line}' is not NAME VALUE; delete the file to start afresh"
            ) from None
    return values
