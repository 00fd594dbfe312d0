"""A comparison as tables, the same for the terminal and the page."""

from __future__ import annotations

from collections.abc import Sequence

from rover_sweep.comparison.answer import Agreement, Comparison, Correction, Difference, Kind, TwinDrive
from rover_sweep.data.results import Quantity, ends_words, number
from rover_sweep.diagnosis.result import Mismatch
from rover_sweep.report.diagnosis.tables import PLAINLY
from rover_sweep.report.document import Cell, Level, Table, Tone
from rover_sweep.report.wording import band, channel, range_words, symbol, unit

KINDS: dict[Kind, str] = {
    "instrument": "instrument",
    "number": "number",
    "left out": "left out of the simulation",
    "too much": "only in the simulation",
    "size": "other size",
}
NOISE = "RMS of recorded minus simulated over the noise of both together: 1 is agreement."
BOUNDS = (
    "Recordings minus simulation, at 95 %: these runs do not exclude a difference within this range. "
    "relative: 0.05 is 5 % of the number. matters: smaller is normal tolerance."
)
CHANNELS = ("r", "ay", "p", "vy")
AGREES = 1.3


def place_table(places: Sequence[Mismatch]) -> Table:
    """Channel, condition, band and size of each place."""
    rows = tuple(
        (
            Cell(channel(m.channel)),
            Cell(m.condition),
            Cell(band(m.band) if m.band[1] else "0"),
            Cell(
                f"{number(m.residual_over_noise, 2)} ×", "strong" if m.residual_over_noise > PLAINLY else ""
            ),
        )
        for m in places
    )
    headings = ("", "where", "rad/s", "difference / noise")
    return Table("Where simulation and recordings differ", headings, rows, text_columns=2)


def difference_table(found: Sequence[Difference], heading: str) -> Table:
    """Each difference with both values; one row per parameter."""
    rows: list[tuple[Cell, ...]] = []
    for d in found:
        for k, (one, two) in enumerate(zip(d.simulation, d.recordings, strict=True)):
            first = (d.name, KINDS[d.kind]) if k == 0 else ("", "")
            name = "" if one.name == d.name else symbol(one.name)
            rows.append(
                (
                    Cell(first[0], "strong"),
                    Cell(first[1]),
                    Cell(name),
                    Cell(_plain(one)),
                    Cell(value_text(two), "strong"),
                    Cell(unit(two.unit)),
                )
            )
    headings = ("what", "kind", "", "simulation", "recordings (90 %)", "unit")
    return Table(heading, headings, tuple(rows), text_columns=3)


def value_text(v: Quantity) -> str:
    """The value with its interval; "none" for a limit that does not exist."""
    if abs(v.value) >= 1e5:
        return "none"
    return f"{number(v.value, 3)} ({ends_words(v.low, v.high)})"


def _plain(v: Quantity) -> str:
    return "none" if abs(v.value) >= 1e5 else number(v.value, 3)


def agreement_table(agreement: Sequence[Agreement], heading: str = "Difference of each run") -> Table:
    """Each run against its simulation, per channel and over all."""
    shown = [c for c in CHANNELS if any(c in a.channels for a in agreement)]
    rows = tuple(
        (
            Cell(a.run),
            Cell("held out" if a.held_out else "used"),
            *(Cell(number(a.channels.get(c), 2)) for c in shown),
            Cell(number(a.overall, 3), _tone(a.overall)),
        )
        for a in agreement
    )
    headings = ("run", "", *(channel(c) for c in shown), "all")
    return Table(heading, headings, rows, NOISE, 2)


def _tone(level: float) -> Tone:
    return "good" if level <= AGREES else "warn"


def could_differ_table(found: Comparison) -> Table | None:
    """How much each quantity could still differ unseen; None where nothing is known."""
    rows = []
    for name, bounds in found.could_differ.items():
        for parameter, b in bounds.items():
            of = "" if parameter == name else symbol(parameter)
            rows.append(
                (Cell(name), Cell(of), Cell(range_words(b)), Cell(number(b.matters, 2)), Cell(unit(b.unit)))
            )
    if not rows:
        return None
    headings = ("quantity or effect", "", "could differ by", "matters", "unit")
    return Table("What could still differ unseen", headings, tuple(rows), BOUNDS, 2)


def correction_table(corrections: Sequence[Correction], level: Level) -> Table:
    """Entry, simulation before, recordings, simulation after; with the reasons only on a page."""
    reasons = level == "page"
    rows = tuple(
        (
            Cell(c.entry.removeprefix("effects."), "strong"),
            Cell(c.before or "–"),
            Cell(c.recordings or "–"),
            Cell(c.after or "–", "strong"),
            Cell(unit(c.unit)),
            *((Cell(c.reason),) if reasons else ()),
        )
        for c in corrections
    )
    headings = ("entry", "before", "recorded (90 %)", "after", "unit", *(("what it is",) if reasons else ()))
    return Table("What was corrected in the simulated rover", headings, rows, text_columns=6, level=level)


def rounds_table(rounds: Sequence[TwinDrive]) -> Table:
    """The difference of each run in each drive of the simulation."""
    names = list(dict.fromkeys((a.run, a.held_out) for r in rounds for a in r.comparison.agreement))
    rows = tuple(
        (Cell(run), Cell("held out" if held else "used"), *(_level(r, run) for r in rounds))
        for run, held in names
    )
    drives = (
        f"drive {k + 1}" + (f", {r.simulator}" if r.simulator != "plant" else "")
        for k, r in enumerate(rounds)
    )
    return Table("Difference of each run, drive by drive", ("run", "", *drives), rows, NOISE, 2)


def _level(r: TwinDrive, run: str) -> Cell:
    level = next((a.overall for a in r.comparison.agreement if a.run == run), None)
    return Cell(number(level, 3), "" if level is None else _tone(level))
