"""The vehicle file `rover.toml`: read, checked completely, written without losing its comments.

Sections: [vehicle], [steering], [imu], [fit] and [material]; see `example`. Any number, except in [material],
may be `{ value = .., sd = .. }` or `{ value = .., how = "ruler" }` (`vehicle_rules.HOW`). The quantities that
a fit may change are one list, `[fit] free = ["roll_inertia"]`.
"""

from __future__ import annotations

import os
import tomllib
from codecs import BOM_UTF16_LE
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import Any, Literal, get_args

from rover_sweep.data.vehicle_rules import (
    FREE_KEYS,
    HOW,
    KEYS,
    inconsistencies,
    read_material,
    read_number,
    unknown_keys,
)
from rover_sweep.errors import UsageError
from rover_sweep.files.documents import read_toml, toml_hint, write_file

Model = Literal["bicycle", "roll-yaw", "lumped"]
MODELS: tuple[str, ...] = get_args(Model)

# Keys that a model needs in addition to mass, a and b, which every file has.
ROLL = ("sprung_mass", "cg_height_above_roll_centre", "roll_inertia")
NEEDED: dict[Model, tuple[str, ...]] = {
    "bicycle": (),
    "roll-yaw": ROLL,
    "lumped": ROLL,  # its fit begins at the derivatives of a roll-yaw model
}


@dataclass(frozen=True)
class Measured:
    """A number of the vehicle file; `sd` is its standard deviation in the same unit, None if not stated.

    how: the source of `sd`: "" if written, a word of `HOW`, "[material]" or "default".
    """

    value: float
    sd: float | None = None
    how: str = ""

    def __str__(self) -> str:
        return f"{self.value:g}" if self.sd is None else f"{self.value:g} ± {self.sd:.3g}"

    def measured_by(self, wheelbase: float) -> Measured:
        """The number with the standard deviation of its `how`; wheelbase [m]."""
        if self.how not in HOW:
            return self
        return replace(self, sd=HOW[self.how] * (wheelbase if self.how == "ruler" else abs(self.value)))


@dataclass(frozen=True)
class Vehicle:
    """The contents of a vehicle file, in SI units.

    mass, sprung_mass [kg]; cg_to_front_axle (a), cg_to_rear_axle (b) [m];
    cg_height_above_roll_centre (h) [m]: CG of the sprung mass above the roll axis;
    roll_inertia [kg m^2] of the sprung mass about its own CG; yaw_inertia [kg m^2] of the whole vehicle
    about its CG; roll_yaw_inertia [kg m^2], Ixz in the sign of equation (18), 0 if not stated; friction:
    peak side force of the tyres over their load [-]; max_steering_angle [rad] of the road wheels, at which
    larger commands stop;
    trim_us [us]; rad_per_us [rad/us], positive where a larger PWM turns right; measured by `bench`:
    asymmetry e [-], nonlinearity c3 [1/rad^2], deadband, backlash (halves) [rad], servo_lag,
    servo_delay [s], servo_rate_limit [rad/s], all at the road wheel;
    imu_position [m] (forward, right, down) from the CG of the sprung mass;
    free: the [vehicle] keys that a fit may change; material: {key of `material_sizes.MATERIAL`: size} that
    replace the defaults. None: not in the file.
    """

    mass: Measured
    cg_to_front_axle: Measured
    cg_to_rear_axle: Measured
    name: str = ""
    sprung_mass: Measured | None = None
    cg_height_above_roll_centre: Measured | None = None
    roll_inertia: Measured | None = None
    yaw_inertia: Measured | None = None
    roll_yaw_inertia: Measured | None = None
    friction: Measured | None = None
    max_steering_angle: Measured | None = None
    trim_us: Measured | None = None
    rad_per_us: Measured | None = None
    asymmetry: Measured | None = None
    nonlinearity: Measured | None = None
    deadband: Measured | None = None
    backlash: Measured | None = None
    servo_lag: Measured | None = None
    servo_delay: Measured | None = None
    servo_rate_limit: Measured | None = None
    imu_position: tuple[Measured, Measured, Measured] | None = None
    free: tuple[str, ...] = ()
    material: Mapping[str, float] = field(default_factory=dict)

    @property
    def wheelbase(self) -> float:
        """a + b, m."""
        return self.cg_to_front_axle.value + self.cg_to_rear_axle.value

    @property
    def imu_iso(self) -> tuple[float, float, float]:
        """(forward, left, up) [m] of the IMU from the CG of the sprung mass; zero if not stated."""
        if self.imu_position is None:
            return 0.0, 0.0, 0.0
        forward, right, down = (m.value for m in self.imu_position)
        return forward, 0.0 - right, 0.0 - down  # 0 - x avoids -0.0

    def missing_for(self, model: Model) -> tuple[str, ...]:
        """The keys of [vehicle] that `model` needs and the file lacks."""
        return tuple(key for key in NEEDED[model] if getattr(self, key) is None)

    def require(self, model: Model) -> None:
        """UsageError with example lines if the file lacks something that `model` needs."""
        if missing := self.missing_for(model):
            lines = "".join(f"\n  {KEYS[f'vehicle.{key}'].example}" for key in missing)
            raise UsageError(
                f"the {model} model needs {', '.join(missing)} in the vehicle file; "
                f"add to [vehicle] lines such as:{lines}"
            )

    def steering(self) -> tuple[float, float]:
        """(trim_us [us], rad_per_us [rad/us]); UsageError if the file lacks them."""
        if self.trim_us is None or self.rad_per_us is None:
            raise UsageError(
                "the vehicle file has no [steering], so a PWM cannot be converted to a road-wheel angle; "
                f"add:\n  [steering]\n  {KEYS['steering.trim_us'].example}"
                f"\n  {KEYS['steering.rad_per_us'].example}"
            )
        return self.trim_us.value, self.rad_per_us.value


def example() -> str:
    """A commented rover.toml."""
    return resources.files("rover_sweep.data").joinpath("rover_example.toml").read_text(encoding="utf-8")


def load(path: str | os.PathLike[str]) -> Vehicle:
    """Read a vehicle file; UsageError that lists all problems of the file."""
    return parse(_read(Path(path)), str(path))


def parse(text: str, name: str = "rover.toml") -> Vehicle:
    """A Vehicle from TOML text; UsageError as in `load`. name: of the file, in errors."""
    try:
        data = read_toml(text)
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{name} is not valid TOML: {error}{toml_hint(text, str(error))}") from None
    problems = unknown_keys(data)
    numbers = {key: _number(data, key, problems) for key in KEYS}
    title = _section(data, "vehicle").get("name", "")
    if not isinstance(title, str):
        problems.append(f'[vehicle] name is {title!r}; it must be text in quotes, as in: name = "my rover"')
    imu = _position(data, problems)
    free = _free(data, problems)
    material, complaints = read_material(_section(data, "material"))
    problems += complaints
    values = {key: number.value for key, number in numbers.items() if number is not None}
    problems += inconsistencies(values, tuple(m.value for m in imu) if imu else None)
    if problems:
        listed = "".join(f"\n  - {problem}" for problem in problems)
        one = f"{name}: {problems[0]}"
        raise UsageError(one if len(problems) == 1 else f"{name} has {len(problems)} problems:{listed}")
    wheelbase = values["vehicle.cg_to_front_axle"] + values["vehicle.cg_to_rear_axle"]
    fields: dict[str, Any] = {
        key.partition(".")[2]: number and number.measured_by(wheelbase) for key, number in numbers.items()
    }
    if imu:
        x, y, z = (m.measured_by(wheelbase) for m in imu)
        imu = x, y, z
    return Vehicle(name=title, imu_position=imu, free=free, material=material, **fields)


def set_numbers(path: str | os.PathLike[str], numbers: Mapping[str, Measured]) -> Vehicle:
    """Write {key such as "vehicle.yaw_inertia": number} into the file; comments and order are kept.

    The new text is checked before the file changes. Returns the vehicle of the new file.
    """
    import tomlkit.items

    path = Path(path)
    old = _read(path)
    parse(old, str(path))
    document: Any = tomlkit.parse(old)
    for key, number in numbers.items():
        if key not in KEYS:
            raise ValueError(f"{key} is not a number of the vehicle file")
        section, _, name = key.partition(".")
        table = document[section] if section in document else document.setdefault(section, tomlkit.table())
        fields = {"value": number.value} | ({} if number.sd is None else {"sd": number.sd})
        if isinstance(table.get(name), tomlkit.items.Table):  # written as [vehicle.mass]: change it in place
            table[name].pop("how", None)
            table[name].update(fields)
        else:
            inside = ", ".join(f"{field} = {x!r}" for field, x in fields.items())
            table[name] = tomlkit.value(f"{{ {inside} }}")
    text = tomlkit.dumps(document)
    vehicle = parse(text, str(path))
    write_file(path, text)
    return vehicle


def _read(path: Path) -> str:
    """The text: UTF-8, or UTF-16 as PowerShell's `>` writes it; the Notepad of Windows puts a mark first."""
    try:
        data = path.read_bytes()
        return data.decode("utf-16" if data.startswith(BOM_UTF16_LE) else "utf-8-sig")
    except FileNotFoundError:
        raise UsageError(
            f"there is no vehicle file {path}; create one with: rover-sweep vehicle --example > {path}"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"the vehicle file {path} cannot be read: {error}") from None


def _section(data: dict[str, Any], name: str) -> dict[str, Any]:
    section = data.get(name, {})
    return section if isinstance(section, dict) else {}


def _number(data: dict[str, Any], key: str, problems: list[str]) -> Measured | None:
    """The number at `key`, None if absent; a sentence on a problem is added to `problems`."""
    section, _, name = key.partition(".")
    table, rule = _section(data, section), KEYS[key]
    if name not in table:
        if rule.required and (section == "vehicle" or section in data):
            problems.append(f"[{section}] {name} is missing; add a line such as: {rule.example}")
        return None
    pair, complaints = read_number(table[name], f"[{section}] {name}", rule)
    problems += complaints
    return Measured(*pair) if pair else None


def _position(data: dict[str, Any], problems: list[str]) -> tuple[Measured, Measured, Measured] | None:
    if "position" not in _section(data, "imu"):
        return None
    entry = _axes(data["imu"]["position"])
    if not isinstance(entry, list) or len(entry) != 3:
        problems.append(
            f"[imu] position is {entry!r}; it must be three numbers [forward, right, down] in m, "
            'such as: position = [0.02, 0.0, 0.05], or { value = [..], how = "ruler" }'
        )
        return None
    one = isinstance(data["imu"]["position"], dict)
    read = [
        read_number(part, "[imu] position" if one else f"[imu] position[{i}]", None)
        for i, part in enumerate(entry)
    ]
    problems += dict.fromkeys(complaint for _, complaints in read for complaint in complaints)
    x, y, z = (pair and Measured(*pair) for pair, _ in read)
    return (x, y, z) if x and y and z else None


def _axes(entry: Any) -> Any:
    """{ value = [x, y, z], sd = one or [..] } as one entry for each axis; anything else as it is."""
    if not isinstance(entry, dict) or not isinstance(values := entry.get("value"), list):
        return entry
    sd = entry.get("sd")
    every = sd if isinstance(sd, list) else [sd] * len(values)
    if len(every) != len(values):
        return entry
    return [{**entry, "value": value, "sd": one} for value, one in zip(values, every, strict=True)]


def _free(data: dict[str, Any], problems: list[str]) -> tuple[str, ...]:
    names = _section(data, "fit").get("free", [])
    if not isinstance(names, list):
        problems.append(f'[fit] free is {names!r}; it must be a list, as in: free = ["roll_inertia"]')
        return ()
    for name in names:
        if name not in FREE_KEYS:
            problems.append(f"[fit] free contains {name!r}; it may contain {', '.join(FREE_KEYS)}")
        elif name not in _section(data, "vehicle"):
            problems.append(f"[fit] free contains {name}, but [vehicle] has no {name} as its starting value")
    return tuple(dict.fromkeys(name for name in names if name in FREE_KEYS))
