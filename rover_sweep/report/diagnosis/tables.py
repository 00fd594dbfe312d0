"""A diagnosis as tables, the same for the terminal and the page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rover_sweep.data.results import Quantity, ends_words, number
from rover_sweep.diagnosis.result import Diagnosis, Finding, HeldOut, Unknown, changes_turns
from rover_sweep.report.document import Cell, Table, Tone
from rover_sweep.report.wording import (
    SHORT_NAMES,
    band,
    capital,
    change,
    channel,
    range_words,
    symbol,
    title,
    unit,
)

ROOM = 24  # characters of a run's name
PLAINLY = 3.0  # times the noise floor: a residual this large is visible in a time history
FLOOR = (
    "J_rms in deg/s and ft/s², with the noise; TIC 0 (perfect) to 1. Share removed: of the squared residual "
    "above the noise floor, the only part that a model can explain."
)

BOUNDS = (
    "could be: these runs do not exclude this size at 95 %. matters: smaller is normal tolerance. change: of "
    "r or a_y in these runs (rms) from normal tolerance to that size, without refitting the model; from 5 % "
    "it is noticed in turns and gains."
)


SCORES = (
    "Each candidate alone, compared with the model without effects. Effects overlap, so more candidates than "
    "the named ones exceed chance; the named ones are those that the whole search kept."
)


def mismatch_table(found: Diagnosis) -> Table:
    """Channel, band, condition and size of each mismatch."""
    rows = tuple(
        (Cell(channel(m.channel)), Cell(m.condition), Cell(_band(m.band)), _size(m.residual_over_noise))
        for m in found.mismatch
    )
    headings = ("", "where", "rad/s", "residual / noise")
    return Table("Where simulation and recording differ", headings, rows, text_columns=2)


def _band(limits: tuple[float, float]) -> str:
    """A band in rad/s, 0 for a steady mismatch."""
    return band(limits) if limits[1] else "0"


def _size(ratio: float) -> Cell:
    return Cell(f"{number(ratio, 2)} ×", "strong" if ratio > PLAINLY else "")


def value_table(values: Sequence[Quantity], heading: str) -> Table:
    """Parameter, meaning, value, 90 % interval, unit."""
    rows = tuple(
        (
            Cell(symbol(v.name)),
            Cell(v.meaning),
            Cell(number(v.value, 3), "strong"),
            Cell(ends_words(v.low, v.high)),
            Cell(unit(v.unit)),
        )
        for v in values
    )
    return Table(heading, ("", "", "value", "90 % interval", "unit"), rows, text_columns=2)


def held_out_table(held_out: Sequence[HeldOut], heading: str, note: bool = True) -> Table:
    """J_rms and TIC before and after on each held-out run, and the share of the explainable error removed."""
    headings = ("run", "J_rms before", "after", "TIC before", "after", "share removed")
    rows = tuple(
        (
            Cell(_ending(h.run)),
            *_pair(h.before.j_rms, h.after.j_rms, 3),
            *_pair(h.before.tic, h.after.tic, 2),
            Cell(share(h.share_removed)),
        )
        for h in held_out
    )
    return Table(heading, headings, rows, FLOOR if note else "")


def _ending(name: str) -> str:
    """The name of a run, cut at the front where it would leave no width for the numbers."""
    return name if len(name) <= ROOM else f"…{name[1 - ROOM :]}"


def _pair(before: float, after: float, digits: int) -> tuple[Cell, Cell]:
    tone: Tone = "good" if after < before else "warn" if after > 1.05 * before else ""
    return Cell(number(before, digits)), Cell(number(after, digits), tone)


def share(value: float | None) -> str:
    """A share as a percentage, at most 100 %; "at the floor" if there was nothing to remove."""
    return "at the floor" if value is None else f"{100 * min(value, 1.0):.0f} %"


def cost_table(held_out: Sequence[HeldOut]) -> Table | None:
    """J per response before and after on held-out sweeps; None without a held-out sweep."""
    having = [h for h in held_out if h.before.cost]
    if not having:
        return None
    outputs = list(dict.fromkeys(o for h in having for o in (*h.before.cost, *h.after.cost)))
    rows = tuple(
        (Cell(_ending(h.run)), Cell(label), *(Cell(_cost(fit.cost.get(o))) for o in outputs))
        for h in having
        for label, fit in (("before", h.before), ("after", h.after))
    )
    headings = ("run", "", *(f"J of {SHORT_NAMES.get(o, o)}" for o in outputs))
    note = "J combines dB and deg; up to 100 is good."
    return Table("Cost of the frequency responses", headings, rows, note, 2)


def _cost(value: float | None) -> str:
    """A cost with one decimal, none from 100 on."""
    return "–" if value is None else f"{value:.1f}" if value < 100 else f"{value:.0f}"


def falsified_table(found: Diagnosis) -> Table | None:
    """Nominal parameters without and with the missing effects, and their error; None for none."""
    if not found.falsified:
        return None
    rows = tuple(
        (
            Cell(symbol(f.name)),
            Cell(number(f.before, 3)),
            Cell(number(f.after, 3)),
            Cell(unit(f.unit)),
            Cell(change(100 * (f.before / f.after - 1)) if f.after else "–"),
        )
        for f in found.falsified
    )
    headings = ("parameter", "without the effect", "with it", "unit", "error without, %")
    return Table("Parameters biased by the missing effect", headings, rows)


def score_table(found: Diagnosis) -> Table | None:
    """Reduction of chi-squared by each candidate alone, largest first; None for none."""
    if not found.scores:
        return None
    known = {e: max(float(s), 0.0) if np.isfinite(s) else 0.0 for e, s in found.scores.items()}
    named = {f.effect for f in found.findings}
    alike = {e for f in found.findings for e in f.look_alikes} - named
    rows = []
    for effect in sorted(known, key=lambda e: -known[e]):
        role = "named" if effect in named else "look-alike" if effect in alike else ""
        tone: Tone = "strong" if effect in named else ""
        rows.append((Cell(effect, tone), Cell(role), Cell(number(known[effect], 3), tone)))
    return Table("All candidates", ("effect", "", "chi-squared falls by"), tuple(rows), SCORES, 2)


def unseen_table(found: Diagnosis) -> Table | None:
    """Effects that these runs cannot detect, with the reason; None for none."""
    rows = tuple((Cell(u.effect), Cell(u.why)) for u in found.cannot_see if not u.up_to)
    if not rows:
        return None
    return Table("Effects that these runs cannot detect", ("effect", "why"), rows, text_columns=2)


def bound_table(found: Diagnosis, noticed: bool) -> Table | None:
    """The size up to which each effect that was not found could be there; None for none.

    noticed: those that would change turns noticeably, or else the others.
    """
    chosen = (u for u in found.cannot_see if u.up_to and changes_turns(u) == noticed)
    bounded = sorted(chosen, key=lambda u: -(u.change or 0.0))
    if not bounded:
        return None
    rows: list[tuple[Cell, ...]] = []
    for u in bounded:
        for k, (name, bound) in enumerate(u.up_to.items()):
            of_effect = (u.effect, _changed(u.change)) if k == 0 else ("", "")
            size = Cell(range_words(bound), "warn" if noticed and k == 0 else "")
            matters = Cell(number(bound.matters, 2))
            rows.append(
                (
                    Cell(of_effect[0]),
                    Cell(symbol(name)),
                    size,
                    matters,
                    Cell(unit(bound.unit)),
                    Cell(of_effect[1]),
                )
            )
    headings = ("effect", "", "could be", "matters", "unit", "change")
    words = f"{'Would' if noticed else 'Would not'} noticeably change turns and gains"
    return Table(words, headings, tuple(rows), BOUNDS, 2)


def _changed(share: float | None) -> str:
    return "–" if share is None else f"{number(100 * share, 2)} %"


def look_alike_words(f: Finding) -> str:
    """A sentence with the effects that these runs cannot separate from it, "" for none."""
    if not f.look_alikes:
        return ""
    look_alikes = [f"{title(e)} ({e}{_share(f, e)})" for e in f.look_alikes]
    return f"These runs cannot separate it from: {'; '.join(look_alikes)}."


def next_words(f: Finding) -> str:
    """The run to drive next and its purpose, "" for none."""
    if not f.next_run:
        return ""
    return f"To {'separate them' if f.look_alikes else 'confirm it'}: {f.next_run}"


def _share(f: Finding, effect: str) -> str:
    share = f.evidence.get(f"probability:{effect}")
    return "" if share is None else f", {100 * share:.0f} %"


def evidence_words(f: Finding) -> str:
    """Reduction of chi-squared; "" if unknown."""
    gain, chance = f.evidence.get("gain"), f.evidence.get("threshold")
    if not gain:
        return ""
    limit = f" (by chance: at most {number(chance, 3)})" if chance else ""
    return f"Chi-squared falls by {number(gain, 3)}{limit}."


def certainty_words(f: Finding) -> str:
    """How sure the finding is; "" if unknown."""
    if f.probability is None:
        return ""
    sure = "more than 99" if f.probability > 0.995 else f"{100 * f.probability:.0f}"
    return f"Probability that this effect is present and matters: {sure} %."


def finding_title(f: Finding) -> str:
    """The name of the effect in words."""
    return capital(title(f.effect))


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
