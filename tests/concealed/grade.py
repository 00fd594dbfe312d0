"""One answer against its truth, by the rules of the proof: any extra wrong name makes a set wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tests.concealed.effects import table

Mark = Literal[
    "exact",
    "look-alike",
    "wrong",
    "missed",
    "none",
    "false alarm",
    "both",
    "one",
    "unknown",
    "nearest",
    "failed",
]
INSTANTS = ("t", "psi0")  # parameters whose size is no scale for their error


@dataclass(frozen=True)
class Graded:
    """One answer, judged.

    mark: see the functions. look_alikes: sizes of the look-alike sets named. errors: relative errors of the
    parameters of rightly named effects; covered: whether their 90 % intervals held the truth.
    share: of the explainable held-out error removed.
    """

    name: str
    kind: str
    truth: tuple[str, ...]
    named: tuple[str, ...]
    mark: Mark
    verdict: str
    look_alikes: tuple[int, ...]
    errors: tuple[float, ...]
    covered: tuple[bool, ...]
    share: float | None
    seconds: float


def grade(name: str, truth: Mapping[str, Any], answer: Mapping[str, Any], seconds: float) -> Graded:
    """Marks one answer; parameters are judged where the effect itself was named."""
    hidden = [one["effect"] for one in truth["effects"]]
    findings = answer["findings"]
    named = [one["effect"] for one in findings]
    sets = [len(one["look_alikes"]) + 1 for one in findings]
    errors, covered = _parameters(truth["effects"], findings)
    return Graded(
        name,
        truth["kind"],
        tuple(hidden),
        tuple(named),
        _mark(truth["kind"], hidden, findings, answer),
        answer["verdict"],
        tuple(sets),
        tuple(errors),
        tuple(covered),
        _share(answer),
        seconds,
    )


def _mark(kind: str, hidden: list[str], findings: list[Mapping[str, Any]], answer: Mapping[str, Any]) -> Mark:
    if answer["verdict"] == "failed":
        return "failed"
    if kind == "none":
        return "false alarm" if findings else "none"
    if kind == "deleted":
        return _mark_deleted(hidden, [one["effect"] for one in findings], answer["unknown"])
    if kind == "unknown":
        return _mark_unknown(hidden[0], [one["effect"] for one in findings], answer["unknown"])
    right, alike = _matched(hidden, findings)
    if len(right | alike) < len(findings) or any(len(one["look_alikes"]) > 2 for one in findings):
        return "wrong"  # a name too many, or a set of look-alikes above three
    return _mark_double(len(right | alike)) if kind == "double" else _mark_single(hidden, right, alike)


def _mark_single(hidden: list[str], right: set[int], alike: set[int]) -> Mark:
    if len(right) == len(hidden):
        return "exact"
    return "look-alike" if len(right | alike) == len(hidden) else "missed"


def _mark_deleted(hidden: list[str], named: list[str], unknown: Any) -> Mark:
    """What the tool says where the concealed effect is not in its library."""
    if any(name not in table()["look_alikes"].get(hidden[0], []) for name in named):
        return "wrong"
    if named:
        return "look-alike"
    return "unknown" if unknown else "missed"


def _mark_double(found: int) -> Mark:
    return ("missed", "one", "both")[found]


def _mark_unknown(hidden: str, named: list[str], unknown: Any) -> Mark:
    nearest = table()["unknown"][hidden]["nearest"]
    if any(name not in nearest for name in named):
        return "wrong"
    if named:
        return "nearest"
    return "unknown" if unknown else "missed"


def _matched(hidden: list[str], findings: list[Mapping[str, Any]]) -> tuple[set[int], set[int]]:
    """Indices of `hidden` named exactly, and named by a declared look-alike, each by a finding of its own."""
    free = dict(enumerate(findings))
    right, alike = set(), set()
    for k, effect in enumerate(hidden):
        hit = next((j for j, one in free.items() if one["effect"] == effect), None)
        if hit is not None:
            right.add(k)
            del free[hit]
    for k, effect in enumerate(hidden):
        hit = next((j for j, one in free.items() if k not in right and _stands_for(effect, one)), None)
        if hit is not None:
            alike.add(k)
            del free[hit]
    return right, alike


def _stands_for(effect: str, finding: Mapping[str, Any]) -> bool:
    """The finding names the effect among its look-alikes, or is one that was declared beforehand."""
    return effect in finding["look_alikes"] or finding["effect"] in table()["look_alikes"].get(effect, [])


def _parameters(
    hidden: list[Mapping[str, Any]], findings: list[Mapping[str, Any]]
) -> tuple[list[float], list[bool]]:
    errors: list[float] = []
    covered: list[bool] = []
    for one in hidden:
        for finding in (f for f in findings if f["effect"] == one["effect"]):
            error, inside = _one_effect(one["parameters"], finding["parameters"])
            errors += error
            covered += inside
    return errors, covered


def _one_effect(
    true: Mapping[str, float], found: Mapping[str, Mapping[str, Any]]
) -> tuple[list[float], list[bool]]:
    """Relative error of the parameters (of a mix of like units together), and coverage of each."""
    names = [name for name in true if name in found and name not in INSTANTS and np.isfinite(true[name])]
    inside = [
        found[name]["low"] <= true[name] <= found[name]["high"]
        for name in names
        if found[name].get("low") is not None and found[name].get("high") is not None
    ]
    errors = [_error(name, found[name]["value"], true[name]) for name in names if true[name] != 0]
    if set(names) >= {"x", "z"}:  # an offset in a plane: one length
        gap = np.hypot(*(found[name]["value"] - true[name] for name in ("x", "z")))
        errors = [float(gap / np.hypot(true["x"], true["z"]))]
    return errors, inside


def _error(name: str, value: float, true: float) -> float:
    """Relative error; a ratio is absent at 1, so its logarithm is what has a size."""
    if name == "ratio":
        return float(abs(np.log(value / true)) / abs(np.log(true)))
    return abs(value - true) / abs(true)


def _share(answer: Mapping[str, Any]) -> float | None:
    """Share of the explainable held-out error that all findings removed together."""
    shares = [row.get("share_removed") for row in _held_out(answer)] if answer["findings"] else []
    known = [float(share) for share in shares if share is not None]
    return known[0] if known else None


def _held_out(finding: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The issue's contract has one run here; several may be listed."""
    held = finding.get("held_out") or []
    return [held] if isinstance(held, Mapping) else list(held)
