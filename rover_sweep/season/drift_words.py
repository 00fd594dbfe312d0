"""The words of a season."""

from __future__ import annotations

from rover_sweep.season.changes import FEWEST
from rover_sweep.season.season_result import Drift, Season


def drift_sentence(d: Drift, previous: str, last: str) -> str:
    """One change of a quantity in one sentence. previous: the day before d.day; last: of the season."""
    assert d.before is not None and d.after is not None and d.low is not None and d.high is not None
    unit = f" {d.unit}" if d.unit else ""
    if d.relative:
        ends = sorted((100.0 * (d.low - 1.0), 100.0 * (d.high - 1.0)))
        share = 100.0 * (d.after / d.before - 1.0)
        size = f"{share:+.0f} % (90 %: {ends[0]:+.0f} to {ends[1]:+.0f})"
    else:
        size = f"{d.after - d.before:+.3g}{unit} (90 %: {d.low:+.3g} to {d.high:+.3g})"
    values = f"from {d.before:.3g} to {d.after:.3g}{unit}"
    if d.kind == "gradual":
        begins = d.day if d.earliest == d.latest else f"{d.day} ({d.earliest} to {d.latest})"
        words = f"{d.quantity} ({d.meaning}) drifts {values} by {last}, {size}; it begins after {begins}"
    elif d.kind == "day":
        words = f"{d.quantity} ({d.meaning}) was different on {d.day} only, {values}, {size}"
    else:
        when = f"between {previous} and {d.day}"
        if d.earliest != d.latest:
            when += f" (first other day: {d.earliest} to {d.latest})"
        words = f"{d.quantity} ({d.meaning}) changed {when}, {values}, {size}"
    alike = f"; {', '.join(d.look_alikes)} would look alike" if d.look_alikes else ""
    changed = ", ".join(f"{p.name} {p.before:g} to {p.after:g}" for p in d.parameters[:5])
    more = f"; parameters that changed meanwhile: {changed}" if changed else ""
    return f"{d.vehicle}: {words}{alike}{more}"


def season_sentence(season: Season) -> str:
    """The answer in one sentence."""
    found = season.drifts
    fitted = season.logs - len(season.refused)
    of = f"{fitted} of {season.logs} logs of {len(season.vehicles)} vehicle(s)"
    left = f"; {len(season.refused)} could not be used" if season.refused else ""
    short = sum(not v.quantities for v in season.vehicles)
    if short:
        left += f"; {short} vehicle(s) with fewer than {FEWEST} days were not searched for drifts"
    if not found and short == len(season.vehicles):
        return f"no drift was searched in {of}{left}"
    if not found:
        return f"nothing drifted in {of}{left}"
    named = list(dict.fromkeys(d.vehicle for d in found))
    return f"{len(found)} change(s) on {len(named)} vehicle(s) ({', '.join(named)}) in {of}{left}"
