"""A plan as tables and as JSON."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from rover_sweep.diagnosis.plans.plan_result import DetectableSize, Plan, PlannedRun, SimilarPair
from rover_sweep.diagnosis.plans.proposals import NAMES
from rover_sweep.report.identification.comparison import Cell, Table
from rover_sweep.report.identification.terminal import Sentence, rich_table
from rover_sweep.report.wording.effect_names import sentence
from rover_sweep.report.wording.number_format import number, unit
from rover_sweep.report.wording.strict_json import plain

FORMAT_VERSION = 2
SIZES = (
    "detectable: size from which a diagnosis is expected to name the effect with 80 %. "
    "matters: smaller is normal tolerance."
)


def plan_document(plan: Plan) -> dict[str, Any]:
    """The plan in plain JSON types; units in the keys or in "units"."""
    return plain(
        {
            "format": "rover-sweep plan",
            "format_version": FORMAT_VERSION,
            "sentences": plan.sentences,
            "runs": [asdict(run) for run in plan.runs],
            "detectable": {effect: asdict(size) for effect, size in plan.detectable.items()},
            "not_told_apart": [asdict(pair) for pair in plan.look_alikes],
            "cannot_see": [{"effect": u.effect, "why": u.why} for u in plan.cannot_see],
            "proposal": [asdict(run) for run in plan.proposal],
            "settles": plan.settles,
            "notes": plan.notes,
            "not_told_apart_with_the_proposal": [asdict(pair) for pair in plan.proposed_look_alikes],
            "units": "amplitude_us, bias_us: us; speed: m/s, 0 on blocks; heading: deg clockwise from north",
        }
    )


def plan_summary(plan: Plan) -> Group:
    """Sentences, runs, detectable sizes, limits and proposed runs, for `Console.print`."""
    parts: list[RenderableType] = []
    for k, part in enumerate(_parts(plan)):
        parts += [Text(""), part] if k else [part]
    return Group(*parts)


def _parts(plan: Plan) -> Iterator[RenderableType]:
    if plan.sentences:
        first, *rest = plan.sentences
        yield Group(Sentence(sentence(first), "bold"), *(Sentence(sentence(text)) for text in rest))
    if plan.runs:
        yield rich_table(run_table(plan.runs, "These runs"))
    if plan.detectable:
        yield rich_table(size_table(plan))
    if plan.look_alikes:
        yield rich_table(pair_table(plan.look_alikes, "Effects that these runs cannot separate"))
    if plan.cannot_see:
        rows = tuple((Cell(u.effect), Cell(u.why)) for u in plan.cannot_see)
        yield rich_table(
            Table("Effects that these runs cannot detect", ("effect", "why"), rows, text_columns=2)
        )
    if plan.proposal:
        yield rich_table(
            run_table(plan.proposal, "Additional runs to drive" if plan.runs else "Runs to drive")
        )
        if plan.settles:
            yield Group(*(Sentence(sentence(text)) for text in plan.settles))
        if plan.proposed_look_alikes:
            yield rich_table(pair_table(plan.proposed_look_alikes, "Effects still not separated with them"))
    if plan.notes:
        yield Group(*(Sentence(sentence(text)) for text in plan.notes))


def run_table(runs: Sequence[PlannedRun], heading: str) -> Table:
    """Kind, amplitude, speed, heading and number of each run."""
    rows = tuple(_run(run) for run in runs)
    return Table(heading, ("", "amplitude, us", "speed, m/s", "heading, deg", "times"), rows)


def _run(run: PlannedRun) -> tuple[Cell, ...]:
    kind = NAMES[run.kind] + (f", {run.name}" if run.name else "")
    amplitude = f"{run.amplitude_us:g}" + (f" about {run.bias_us:+g}" if run.bias_us else "")
    speed = f"{run.speed:g}" if run.speed else "0"
    heading = "any" if run.heading is None else f"{run.heading:.0f}"
    return Cell(kind), Cell(amplitude), Cell(speed), Cell(heading), Cell(str(run.repeat))


def size_table(plan: Plan) -> Table:
    """Detectable size of each effect, in the plan's order; marked where it exceeds the size that matters."""
    rows = tuple(_size(effect, size) for effect, size in plan.detectable.items())
    return Table("Detectable sizes", ("effect", "", "detectable", "matters", "unit"), rows, SIZES, 2)


def _size(effect: str, size: DetectableSize) -> tuple[Cell, ...]:
    too_large = size.size is None or (size.material is not None and size.size > size.material)
    return (
        Cell(effect),
        Cell(size.parameter),
        Cell(number(size.size, 2), "warn" if too_large else ""),
        Cell(number(size.material, 2)),
        Cell(unit(size.unit)),
    )


def pair_table(pairs: Sequence[SimilarPair], heading: str) -> Table:
    """Pairs of effects with the expected probability of the second where the first is true."""
    rows = tuple((Cell(p.first), Cell(p.second), Cell(f"{100 * p.probability:.0f} %")) for p in pairs)
    return Table(heading, ("true", "explains it as well", "probability"), rows, text_columns=2)
