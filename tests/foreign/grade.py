"""A diagnosis as an answer in plain JSON types, its marks against the truth, and recorded rovers.

A finding is right if its effect is hidden ("first"), or if a hidden effect is among its look-alikes
("alike"); anything else is a wrong name. A finding settles one hidden effect, and a hidden effect needs one.
"""

from __future__ import annotations

import json
import tarfile
import tempfile
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rover_sweep as rs
from rover_sweep.api.diagnose import FullDiagnosis, diagnose
from rover_sweep.api.read import Runs
from rover_sweep.data.recording import Recording
from rover_sweep.report.diagnosis.diagnosis_json import diagnosis_document

KEPT = (
    "verdict", "sentence", "findings", "unknown", "cannot_see", "held_out", "remarks", "scores", "p_none",
    "p_else",
)  # fmt: skip
LATER = ("form", "probability")  # fields of a finding that a version of the tool may have or lack
OUTSIDE = "outside:"

# Two names of one physics: each is right for the other.
SAME: dict[str, frozenset[str]] = {
    "transport_delay": frozenset({"servo_lag", "clock_offset"}),  # lateness of the steering
    "servo_lag": frozenset({"transport_delay"}),
}

# Names that are near the truth though the law is outside the list: counted apart, neither right nor wrong.
NEAREST: dict[str, frozenset[str]] = {
    "outside:cubic_hysteresis": frozenset(
        {"steering_nonlinearity", "steering_backlash", "steering_stiction"}
    ),
    "outside:tyre_dead_zone": frozenset({"steering_deadband"}),
    "outside:tyre_left_right": frozenset({"steering_asymmetry"}),
    "outside:resonant_linkage": frozenset({"servo_lag"}),
    "outside:slip_speed": frozenset({"tyre_speed"}),
    "outside:sliding_cargo": frozenset({"imu_offset"}),  # the CG moves away from the IMU
}

# Words of a place in the equations that are right for a law outside the list.
PLACES: dict[str, tuple[str, ...]] = {
    "outside:resonant_linkage": ("steering",),
    "outside:cubic_hysteresis": ("steering",),
    "outside:flexing_mast": ("sensor", "a_y", "ay", "roll"),
    "outside:yaw_drag": ("yaw moment",),
    "outside:tyre_left_right": ("side force",),
    "outside:sliding_cargo": ("yaw moment", "side force"),
    "outside:slosh": ("side force", "roll moment"),
    "outside:speed_steering": ("steering",),
    "outside:tyre_dead_zone": ("side force",),
    "outside:aliased_vibration": ("sensor", "a_y", "ay"),
    "outside:wheel_unbalance": ("sensor", "a_y", "ay"),
    "outside:rear_linkage": ("side force", "yaw moment"),
    "outside:pendulum": ("side force", "roll moment"),
    "outside:sliding_load": ("side force", "roll moment", "yaw moment"),
    "outside:toe_compliance": ("steering", "side force"),
    "outside:slip_speed": ("side force", "yaw moment", "speed"),
    "outside:bump_stops": ("roll moment",),
    "outside:wheel_lift": ("side force", "roll moment"),
    "outside:limping_motor": ("yaw moment",),
}


def answered(runs: Runs, held_out: Sequence[Recording], **settings: Any) -> dict[str, Any]:
    """`answer` of these runs with "seconds"; an exception gives the verdict "failed" with its traceback."""
    started = time.monotonic()
    try:
        found = answer(diagnose(runs, held_out, **settings))
    except Exception:  # a traceback is a result here
        found = {"verdict": "failed", "sentence": traceback.format_exc(), "findings": [], "unknown": None}
    return {**found, "seconds": round(time.monotonic() - started, 1)}


def answer(found: FullDiagnosis) -> dict[str, Any]:
    """What is graded and kept of a diagnosis; keys as in diagnosis.json."""
    document = diagnosis_document(found, found.origin)
    kept = {key: document.get(key) for key in KEPT}
    for one, finding in zip(kept["findings"], found.findings, strict=True):
        one.update({name: getattr(finding, name) for name in LATER if hasattr(finding, name)})
    kept["cannot_see"] = [one for one in kept["cannot_see"] if one.get("up_to")]
    return kept


@dataclass(frozen=True)
class Graded:
    """One answer, judged. first, alike, wrong, nearest: effects; missed: hidden effects without a finding.

    placed: the unknown lies at a place of PLACES; None where nothing outside the list is hidden.
    """

    name: str
    kind: str
    hidden: tuple[str, ...]
    verdict: str
    first: tuple[str, ...]
    alike: tuple[str, ...]
    nearest: tuple[str, ...]
    wrong: tuple[str, ...]
    missed: tuple[str, ...]
    unknown: bool
    seconds: float
    placed: bool | None = None

    @property
    def named(self) -> int:
        """How many effects were named."""
        return len(self.first) + len(self.alike) + len(self.nearest) + len(self.wrong)

    @property
    def mark(self) -> str:
        """exact, look-alike, part, nearest, wrong, unknown, nothing, none (rightly), refused or failed."""
        if self.verdict in ("failed", "refused"):
            return self.verdict
        if self.wrong:
            return "wrong"
        if not self.hidden and not self.named:
            return "none"
        inside = [effect for effect in self.hidden if not effect.startswith(OUTSIDE)]
        if inside and len(self.first) == len(inside):
            return "exact"
        if inside and len(self.first) + len(self.alike) == len(inside):
            return "look-alike"
        if self.first or self.alike:
            return "part"
        if self.nearest:
            return "nearest"
        return "unknown" if self.unknown else "nothing"


def grade(
    name: str,
    kind: str,
    hidden: Sequence[str],
    answer: Mapping[str, Any],
    places: Mapping[str, tuple[str, ...]] = PLACES,
) -> Graded:
    """Marks one answer. hidden: effect ids. answer: verdict, findings, unknown, seconds.

    places: as PLACES, {effect: words}.
    """
    missing = list(hidden)
    marks: dict[str, list[str]] = {"first": [], "alike": [], "nearest": [], "wrong": []}
    for finding in _surest_first(answer["findings"], hidden):
        match, settled = _match(finding, missing)
        marks[match].append(finding["effect"])
        if settled in missing:
            missing.remove(settled)
    return Graded(
        name,
        kind,
        tuple(hidden),
        answer["verdict"],
        missed=tuple(missing),
        unknown=bool(answer.get("unknown")),
        seconds=float(answer["seconds"]),
        placed=_placed(hidden, answer.get("unknown"), places),
        **{mark: tuple(effects) for mark, effects in marks.items()},
    )


def _placed(
    hidden: Sequence[str], unknown: Mapping[str, Any] | None, places: Mapping[str, tuple[str, ...]]
) -> bool | None:
    words = [word for effect in hidden for word in places.get(effect, ())]
    if not words:
        return None
    said = unknown or {}
    text = str(said.get("place") or said.get("law") or said.get("channel") or "")
    return any(word in text for word in words)


def _surest_first(findings: Sequence[Mapping[str, Any]], hidden: Sequence[str]) -> list[Mapping[str, Any]]:
    """Findings whose own name is hidden before those that match by a look-alike."""
    return sorted(findings, key=lambda one: one["effect"] not in hidden)


def _match(finding: Mapping[str, Any], missing: Sequence[str]) -> tuple[str, str]:
    """("first", "alike", "nearest" or "wrong", the hidden effect that it settles)."""
    effect, alike = finding["effect"], finding.get("look_alikes") or []
    for one in missing:
        if effect == one or effect in SAME.get(one, ()):
            return "first", one
    for one in missing:
        if one in alike:
            return "alike", one
    for one in missing:
        if effect in NEAREST.get(one, ()):
            return "nearest", ""
    return "wrong", ""


def line(graded: Graded, answer: dict[str, Any], truth: str = "") -> str:
    """One set: mark, truth beside findings (with look-alikes and share removed), unknown, time."""
    said = "; ".join(_finding_words(one) for one in answer["findings"]) or "-"
    unknown = answer.get("unknown")
    where = (unknown.get("place") or unknown["channel"], unknown.get("law") or "") if unknown else ()
    place = f"  unknown: {' '.join(where)}" if where else ""
    truth = truth or ", ".join(graded.hidden) or "none"
    verdict = answer["verdict"]
    why = f" ({answer['sentence'].strip().splitlines()[-1]})" if verdict in ("failed", "refused") else ""
    return f"{graded.name:<7}{graded.mark:<11}{truth} | {verdict}{why}: {said}{place}  {graded.seconds:.0f} s"


def _finding_words(one: dict[str, Any]) -> str:
    values = ", ".join(f"{name} {v['value']:.3g}" for name, v in one["parameters"].items())
    removed = (one.get("held_out") or {}).get("share_removed")
    parts = [one["effect"], f"({values})" if values else "", f"[{one['form']}]" if one.get("form") else ""]
    parts += [f"p {one['probability']:.2f}"] if one.get("probability") is not None else []
    parts += [f"or {'/'.join(one['look_alikes'])}"] if one["look_alikes"] else []
    parts += [f"{100 * removed:.0f} %"] if removed is not None else []
    return " ".join(part for part in parts if part)


# ---- Recorded rovers whose truth is known: a folder with cNN.json and cNN.tar.xz of run1.BIN to run4.BIN.

# {key of "hidden": effect id}; keys that only belong to another one are left out
IDS = {
    "surface_t": "surface_change",
    "servo_rate": "servo_rate_limit",
    "brush": "tyre_saturation",
    "mu": "tyre_saturation",
    "roll_steer": "roll_steer",
    "unbalance": "outside:wheel_unbalance",
    "front_ratio": "front_rear_stiffness",
    "cubic": "steering_nonlinearity",
    "gyro_lp": "sensor_filter",
    "stiction": "steering_stiction",
    "diff": "yaw_damping",
    "bank": "cross_slope",
    "dry_roll": "suspension_friction",
    "vel_lag": "velocity_lag",
    "imu_x": "imu_offset",
    "locked_rear": "yaw_damping",
    "rear_soft": "front_rear_stiffness",
    "play": "steering_backlash",
    "mast": "outside:flexing_mast",
    "slip_speed": "outside:slip_speed",
    "pendulum": "outside:pendulum",
}
PARTS = ("surface_k", "pendulum_hz")


def hidden_ids(hidden: Mapping[str, float]) -> tuple[str, ...]:
    """Effect ids of what a case hides; KeyError for an unknown key."""
    return tuple(IDS[key] for key in hidden if key not in PARTS)


def cases(folder: Path, only: str = "") -> tuple[Path, ...]:
    """The .json of each case that has its recordings; only: names, separated by commas."""
    wanted = set(only.split(",")) if only else None
    found = sorted(p for p in folder.glob("*.json") if p.with_suffix(".tar.xz").exists())
    return tuple(p for p in found if wanted is None or p.stem in wanted)


@contextmanager
def unpacked(path: Path) -> Iterator[tuple[dict[str, Any], Path, list[Path]]]:
    """(content, vehicle file, logs of the four runs) of a case."""
    case = json.loads(path.read_text())
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(path.with_suffix(".tar.xz")) as archive:
            archive.extractall(folder, filter="data")
        vehicle = Path(folder) / "rover.toml"
        vehicle.write_text(vehicle_text(case["told"], above_roll_axis="engine" in case))
        yield case, vehicle, [next(Path(folder).rglob(f"run{k}.BIN")) for k in (1, 2, 3, 4)]


def diagnosed_cases(
    folder: Path, only: str = "", **settings: Any
) -> Iterator[tuple[dict[str, Any], dict[str, Any], str]]:
    """(truth as in `BenchSet`, answer, truth in words) of each case: run 4 is held out."""
    for path in cases(folder, only):
        with unpacked(path) as (case, vehicle, logs):
            runs = rs.read(*logs[:3], vehicle=vehicle)
            found = answered(runs, rs.read(logs[3], vehicle=vehicle), **settings)
        hidden = hidden_ids(case["hidden"])
        truth = ", ".join(f"{key} {value:.3g}" for key, value in case["hidden"].items()) or "none"
        listed = sum(not effect.startswith(OUTSIDE) for effect in hidden)
        kind = ("outside" if hidden else "none", "single", "double", "triple")[listed]
        effects = [{"effect": effect} for effect in hidden]
        yield {"engine": "recorded", "kind": kind, "seed": path.stem, "hidden": effects}, found, truth


def vehicle_text(told: Mapping[str, float], above_roll_axis: bool = False) -> str:
    """The vehicle file (TOML) of what the owner knows.

    imu_z [m]: below the CG. above_roll_axis: imu_z is the height over the roll axis, as in the cases that
    name an engine.
    """
    own = ("rad_per_us", "imu_z")
    down = told.get("imu_z", 0.06)
    if above_roll_axis:
        down = told["cg_height_above_roll_centre"] - down
    lines = ["[vehicle]", *(f"{key} = {value!r}" for key, value in told.items() if key not in own)]
    lines += ["[steering]", "trim_us = 1500", f"rad_per_us = {told['rad_per_us']!r}"]
    return "\n".join([*lines, "[imu]", f"position = [0.0, 0.0, {down!r}]", ""])
