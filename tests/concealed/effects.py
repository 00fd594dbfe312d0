"""What is concealed: ids and parameters of the shared vocabulary, and how much of each is drawn."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from tests.concealed.rover import Rng, Rover

Sizes = Mapping[str, Mapping[str, Any]]
UNKNOWN = ("locked_differential", "flexing_chassis", "side_wind")


@cache
def table() -> Mapping[str, Any]:
    """sizes.toml: detectable sizes, look-alikes, effects out of the library."""
    with Path(__file__).with_name("sizes.toml").open("rb") as file:
        return tomllib.load(file)


def ids() -> tuple[str, ...]:
    """The effects of the vocabulary that can be concealed, in the order of the table."""
    return tuple(name for name in table() if name not in ("unknown", "look_alikes"))


@dataclass(frozen=True)
class Effect:
    """One concealed effect: its id and its parameters by the names, units and conventions of the vocabulary.

    detail: what else the generator must know and the vocabulary does not ask for, as numbers.
    """

    id: str
    parameters: Mapping[str, float]
    detail: Mapping[str, float]
    run: str = ""


Hidden = tuple[Effect, ...]


def part(hidden: Hidden, effect: str, parameter: str, absent: float) -> float:
    """The parameter of a concealed effect, or its absent value; parameters and details alike."""
    for one in hidden:
        if one.id == effect:
            return float({**one.detail, **one.parameters}.get(parameter, absent))
    return absent


def draw_effect(effect: str, factor: float, rover: Rover, rng: Rng, sizes: Sizes | None = None) -> Effect:
    """`effect` at `factor` times its detectable size, with the sign, mix, instant or heading drawn.

    sizes: {effect: {parameter: size}} of this very plan, those of sizes.toml where it is silent.
    """
    entry = table()["unknown"][effect] if effect in UNKNOWN else table()[effect]
    if sizes and effect in sizes:
        entry = {**entry, "parameters": sizes[effect]}
    sizes = _chosen(entry, rng)
    scaling, signed = entry.get("scaling", "proportional"), entry.get("signed", False)
    sign = {name: float(rng.choice([-1.0, 1.0])) if signed else 1.0 for name in sizes}
    values = {
        name: _scaled(scaling, size, factor * share, sign[name]) for name, (size, share) in sizes.items()
    }
    if effect == "tyre_slip":
        values = {"C": (rover.cf + rover.cr) / 2, "Izz": rover.izz}
    if effect == "roll_dof":
        values = {"k_phi": rover.k_phi, "b_phi": rover.b_phi}
    return Effect(effect, *_details(effect, values, rng))


def _chosen(entry: Mapping[str, Any], rng: Rng) -> dict[str, tuple[float, float]]:
    """{parameter: (size, share of the factor)}."""
    sizes, mode = dict(entry["parameters"]), entry.get("mode", "all")
    if mode == "one":
        name = str(rng.choice(list(sizes)))
        return {name: (sizes[name], 1.0)}
    if mode == "mix" and len(sizes) > 1:
        angle = rng.uniform(0.0, np.pi / 2)
        return {
            name: (size, w)
            for (name, size), w in zip(sizes.items(), (np.cos(angle), np.sin(angle)), strict=True)
        }
    return {name: (size, 1.0) for name, size in sizes.items()}


def _scaled(scaling: str, size: float, factor: float, sign: float) -> float:
    if scaling == "inverse":
        return float(size / factor)
    return float(size ** (sign * factor)) if scaling == "ratio" else float(sign * size * factor)


def _details(
    effect: str, values: dict[str, float], rng: Rng
) -> tuple[dict[str, float], dict[str, float], str]:
    """Parameters, details and the run that complete an effect."""
    if effect == "surface_change":
        return (
            {**values, "t": np.nan},
            {"fraction": rng.uniform(0.3, 0.7)},
            str(rng.choice(["run1", "run2", "run3"])),
        )
    if effect == "cross_slope":
        return {**values, "psi0": rng.uniform(-np.pi, np.pi)}, {}, ""
    if effect == "clock_offset":
        return values, {"velocity": 0.0}, ""
    if effect == "side_wind":
        return values, {"heading": rng.uniform(-np.pi, np.pi)}, ""
    if effect == "locked_differential":
        return values, {"threshold": rng.uniform(0.3, 0.5)}, ""
    return values, {}, ""
