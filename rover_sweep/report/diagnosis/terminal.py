"""A diagnosis for the terminal, 80 columns wide."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Group, RenderableType
from rich.text import Text

from rover_sweep.data.braille import braille_lines
from rover_sweep.diagnosis.result import Diagnosis, Finding, LawCurve, Unknown
from rover_sweep.diagnosis.verdict import importance_words
from rover_sweep.report.diagnosis.tables import (
    certainty_words,
    cost_table,
    evidence_words,
    falsified_table,
    finding_table,
    held_out_table,
    look_alike_words,
    mismatch_table,
    next_words,
    unseen_table,
)
from rover_sweep.report.identification.terminal import Sentence, rich_table
from rover_sweep.report.wording.bound_words import hiding_words
from rover_sweep.report.wording.effect_names import channel, sentence
from rover_sweep.report.wording.number_format import number

WIDTH = 80
BENT = 0.05  # share of a curve's height from which its bend is drawn
PLOT = (44, 7)  # characters and rows of a curve
ROOM = 24  # characters of a run's name that leave enough width for the numbers
STYLES = {
    "none": "bold green",
    "explained": "bold",
    "partly explained": "bold",
    "unexplained": "bold yellow",
    "refused": "bold red",
}


def summary(found: Diagnosis) -> Group:
    """Verdict, mismatches, findings, held-out runs, unknown, undetectable, for `Console.print`."""
    return Group(*_spaced(_parts(found)))


def _spaced(parts: Iterator[RenderableType]) -> Iterator[RenderableType]:
    for k, part in enumerate(parts):
        if k:
            yield Text("")
        yield part


def _parts(found: Diagnosis) -> Iterator[RenderableType]:
    yield Group(
        Text(found.verdict.upper(), STYLES[found.verdict]), Sentence(sentence(found.sentence), "bold")
    )
    if hiding := hiding_words(found.cannot_see):
        yield Sentence(sentence(f"could still hide (95 %): {hiding}"))
    if found.mismatch:
        yield rich_table(mismatch_table(found))
    elif found.findings:
        yield Sentence(
            "No residual clearly exceeds the noise floor: the nominal parameters absorb the missing effects."
        )
    if found.findings:
        yield rich_table(finding_table(found))
        yield from (_explained(f) for f in found.findings)
        yield from (_drawn(curve) for curve in found.curves if curve.bend >= BENT)
    if falsified := falsified_table(found):
        yield rich_table(falsified)
    if found.held_out:
        yield rich_table(held_out_table(found.held_out, "On held-out runs", room=ROOM))
    if costs := cost_table(found.held_out, ROOM):
        yield rich_table(costs)
    if found.unknown:
        yield _unknown(found.unknown, found.sentence)
    if unseen := unseen_table(found):
        yield rich_table(unseen)
    if found.remarks:
        yield Group(*(_hanging(sentence(remark)) for remark in found.remarks))


def _explained(f: Finding) -> Group:
    """The finding's sentence, evidence, look-alikes, and the run that would decide."""
    lines: list[RenderableType] = [Text(f.effect, "bold")]
    words = [
        f.sentence,
        importance_words(f),
        f.turn,
        evidence_words(f),
        certainty_words(f),
        look_alike_words(f),
        next_words(f),
    ]
    lines += [_indented(sentence(text)) for text in words if text]
    return Group(*lines)


def _drawn(curve: LawCurve) -> Group:
    """The ends of a curve's 90 % band and the straight line of its middle, in dots."""
    across, up = (min(curve.x), max(curve.x)), (min(curve.low), max(curve.high))
    lines = braille_lines(
        [(curve.x, curve.low), (curve.x, curve.high), (across, curve.straight(across))], across, up, *PLOT
    )
    labels = [number(up[1], 2), *[""] * (PLOT[1] - 2), number(up[0], 2)]
    rows = [f"  {label:>8} ┤{line}" for label, line in zip(labels, lines, strict=True)]
    left, right = (number(end, 2) for end in across)
    return Group(
        Text(f"{curve.place}, {curve.unit}, over {curve.over}, {curve.over_unit}", "bold"),
        Text("\n".join([*rows, f"{'':11}{left}{right:>{PLOT[0] - len(left)}}"])),
        Sentence("Both ends of the 90 % band, and a straight line.", "dim"),
    )


def _unknown(u: Unknown, headline: str) -> Group:
    """What is known of the unexplained part, one line each, without what the headline says already."""
    size = (
        f"{number(u.residual_over_noise, 2)} × the noise in {channel(u.channel)}, depends on {u.depends_on}"
    )
    clauses = [clause for clause in u.sentence.split("; ") if clause not in headline]
    words = [*clauses, size, law_words(u), *held_out_lines(u)]
    return Group(Text("unknown", "bold yellow"), *(_indented(sentence(text)) for text in words if text))


def law_words(u: Unknown) -> str:
    """The fitted laws of the unknown part and the share that it predicts on held-out data, "" for none."""
    if not u.law:
        return ""
    gain = (
        "" if u.law_gain is None else f" (explains {100 * min(u.law_gain, 1.0):.0f} % of it on held-out data)"
    )
    return f"Fitted law{'s' if len(u.curves) > 1 else ''}: {u.law}{gain}"


def held_out_lines(u: Unknown) -> list[str]:
    """The held-out runs without and with the fitted law, one sentence each."""
    if not u.curves:
        return []
    return [
        f"{h.run}, held out: mean square {number(h.before, 2)} times the noise without "
        f"{'the laws' if len(u.curves) > 1 else 'the law'}, {number(h.after, 2)} with "
        f"{'them' if len(u.curves) > 1 else 'it'}"
        for h in u.held_out
    ]


def _indented(text: str) -> Sentence:
    return Sentence(text, first="  ", rest="  ")


def _hanging(text: str) -> Sentence:
    return Sentence(text, "dim", first="- ", rest="  ")
