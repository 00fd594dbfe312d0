"""The tables [[table_law]] of a variant file: the laws without a name of a diagnosed model."""

from __future__ import annotations

from dataclasses import replace

from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.diagnosis.simulation.table_law import TableLaw

IN_THE_PLANT = ("delta", "a_y", "r", "p", "phi", "beta", "v")  # quantities over which the plant has tables


def exported_laws(model: AugmentedModel) -> list[TableLaw]:
    """The laws that the simulated rover has, in its quantities: its trim acts before the table."""
    trim = model.value("trim")
    return [
        replace(law, x=tuple(x - trim for x in law.x))
        if law.place == "steering" and law.memory != "resonance"
        else law
        for law in model.laws
        if _in_the_plant(law)
    ]


def laws_not_in_the_plant(model: AugmentedModel) -> list[str]:
    """A sentence for each law that the simulated rover does not have."""
    return [
        f"the law at the {law.place} over {law.over} is not included: this rover has no such table"
        for law in model.laws
        if not _in_the_plant(law)
    ]


def law_lines(law: TableLaw) -> list[str]:
    """One table as lines of TOML."""
    lines = ["[[table_law]]", f'place = "{law.place}"', f'over = "{law.over}"']
    for name, values in (("x", law.x), ("y", law.y)):
        lines.append(f"{name} = [{', '.join(repr(float(f'{v:.7g}')) for v in values)}]")
    lines += [f'times = "{law.times}"'] if law.times else []
    lines += [f"play = {law.size:.7g}"] if law.memory == "play" else []
    if law.memory == "resonance":
        lines += [f"frequency = {law.size:.7g}", f"damping = {law.damping:.7g}"]
    return lines


def _in_the_plant(law: TableLaw) -> bool:
    return not law.place.startswith("sensor") and law.over in IN_THE_PLANT and law.memory != "lag"
