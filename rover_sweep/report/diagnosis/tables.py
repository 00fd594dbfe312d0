"""A diagnosis as tables, the same for the terminal and the page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rover_sweep.data.results import Quantity, ends_words, number
from rover_sweep.diagnosis.result import Diagnosis, Finding, HeldOut, Mismatch, Unknown, changes_turns
from rover_sweep.report.document import Cell, Table, Tone, table_of
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


def mismatch_table(found: Sequence[Mismatch], heading: str, size: str) -> Table:
    """Channel, condition, band (0 for a steady mismatch) and size of each mismatch. size: its heading."""
    rows = (
        (
            channel(m.channel),
            m.condition,
            band(m.band) if m.band[1] else "0",
            Cell(
                f"{number(m.residual_over_noise, 2)} ×", "strong" if m.residual_over_noise > PLAINLY else ""
            ),
        )
        for m in found
    )
    return table_of(heading, ("", "where", "rad/s", size), rows, text_columns=2)


def value_table(values: Sequence[Quantity], heading: str) -> Table:
    """Parameter, meaning, value, 90 % interval, unit."""
    rows = (
        (
            symbol(v.name),
            v.meaning,
            Cell(number(v.value, 3), "strong"),
            ends_words(v.low, v.high),
            unit(v.unit),
        )
        for v in values
    )
    return table_of(heading, ("", "", "value", "90 % interval", "unit"), rows, text_columns=2)


def held_out_table(held_out: Sequence[HeldOut], heading: str, note: bool = True) -> Table:
    """J_rms and TIC before and after on each held-out run, and the share of the explainable error removed."""

    def pair(before: float, after: float, digits: int) -> tuple[str, Cell]:
        tone: Tone = "good" if after < before else "warn" if after > 1.05 * before else ""
        return number(before, digits), Cell(number(after, digits), tone)

    rows = (
        (
            _ending(h.run),
            *pair(h.before.j_rms, h.after.j_rms, 3),
            *pair(h.before.tic, h.after.tic, 2),
            "at the floor" if h.share_removed is None else f"{100 * min(h.share_removed, 1.0):.0f} %",
        )
        for h in held_out
    )
    headings = ("run", "J_rms before", "after", "TIC before", "after", "share removed")
    return table_of(heading, headings, rows, FLOOR if note else "")


def _ending(name: str) -> str:
    """The name of a run, cut at the front where it would leave no width for the numbers."""
    return name if len(name) <= ROOM else f"…{name[1 - ROOM :]}"


def cost_table(held_out: Sequence[HeldOut]) -> Table:
    """J per response before and after on held-out sweeps, none from 100 on with a decimal."""
    having = [h for h in held_out if h.before.cost]
    outputs = list(dict.fromkeys(o for h in having for o in (*h.before.cost, *h.after.cost)))

    def cost(value: float | None) -> str:
        return "–" if value is None else f"{value:.1f}" if value < 100 else f"{value:.0f}"

    rows = (
        (_ending(h.run), label, *(cost(fit.cost.get(o)) for o in outputs))
        for h in having
        for label, fit in (("before", h.before), ("after", h.after))
    )
    headings = ("run", "", *(f"J of {SHORT_NAMES.get(o, o)}" for o in outputs))
    note = "J combines dB and deg; up to 100 is good."
    return table_of("Cost of the frequency responses", headings, rows, note, 2)


def falsified_table(found: Diagnosis) -> Table:
    """Nominal parameters without and with the missing effects, and their error."""
    rows = (
        (
            symbol(f.name),
            number(f.before, 3),
            number(f.after, 3),
            unit(f.unit),
            change(100 * (f.before / f.after - 1)) if f.after else "–",
        )
        for f in found.falsified
    )
    headings = ("parameter", "without the effect", "with it", "unit", "error without, %")
    return table_of("Parameters biased by the missing effect", headings, rows)


def score_table(found: Diagnosis) -> Table:
    """Reduction of chi-squared by each candidate alone, largest first."""
    known = {e: max(float(s), 0.0) if np.isfinite(s) else 0.0 for e, s in found.scores.items()}
    named = {f.effect for f in found.findings}
    alike = {e for f in found.findings for e in f.look_alikes} - named
    rows = []
    for effect in sorted(known, key=lambda e: -known[e]):
        role = "named" if effect in named else "look-alike" if effect in alike else ""
        tone: Tone = "strong" if effect in named else ""
        rows.append((Cell(effect, tone), role, Cell(number(known[effect], 3), tone)))
    return table_of("All candidates", ("effect", "", "chi-squared falls by"), rows, SCORES, 2)


def bound_table(found: Diagnosis, noticed: bool) -> Table:
    """The size up to which each effect that was not found could be there.

    noticed: those that would change turns noticeably, or else the others.
    """
    chosen = (u for u in found.cannot_see if u.up_to and changes_turns(u) == noticed)
    rows = []
    for u in sorted(chosen, key=lambda u: -(u.change or 0.0)):
        for k, (name, bound) in enumerate(u.up_to.items()):
            changed = "–" if u.change is None else f"{number(100 * u.change, 2)} %"
            size = Cell(range_words(bound), "warn" if noticed and k == 0 else "")
            own = (symbol(name), size, number(bound.matters, 2), unit(bound.unit))
            rows.append(("" if k else u.effect, *own, "" if k else changed))
    headings = ("effect", "", "could be", "matters", "unit", "change")
    words = f"{'Would' if noticed else 'Would not'} noticeably change turns and gains"
    return table_of(words, headings, rows, BOUNDS, 2)


def look_alike_words(f: Finding) -> str:
    """A sentence with the effects that these runs cannot separate from it, "" for none."""
    if not f.look_alikes:
        return ""
    shares = {e: f.evidence.get(f"probability:{e}") for e in f.look_alikes}
    words = {e: "" if p is None else f", {100 * p:.0f} %" for e, p in shares.items()}
    return (
        f"These runs cannot separate it from: {'; '.join(f'{title(e)} ({e}{w})' for e, w in words.items())}."
    )


def next_words(f: Finding) -> str:
    """The run to drive next and its purpose, "" for none."""
    return f"To {'separate them' if f.look_alikes else 'confirm it'}: {f.next_run}" if f.next_run else ""


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
    share_predicted = f"{100 * min(u.law_gain, 1.0):.0f} %" if u.law_gain is not None else ""
    gain = f" (explains {share_predicted} of it on held-out data)" if share_predicted else ""
    return f"Fitted law{'s' if len(u.curves) > 1 else ''}: {u.law}{gain}"


def held_out_lines(u: Unknown) -> list[str]:
    """The held-out runs without and with the fitted law, one sentence each."""
    laws, them = ("the laws", "them") if len(u.curves) > 1 else ("the law", "it")
    return [
        f"{h.run}, held out: mean square {number(h.before, 2)} times the noise without {laws}, "
        f"{number(h.after, 2)} with {them}"
        for h in (u.held_out if u.curves else ())
    ]
