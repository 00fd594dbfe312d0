"""The words of a comparison."""

from __future__ import annotations

from collections.abc import Sequence

from rover_sweep.comparison.answer import Agreement, Difference, Kind, Verdict
from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.result import EffectValue

ABSENT = 1e5  # a limit or a cut-off at or above this does not exist


def difference_sentence(
    kind: Kind,
    name: str,
    simulation: Sequence[EffectValue],
    recordings: Sequence[EffectValue],
    relative: bool,
) -> str:
    """One difference in one sentence, with both values and their intervals."""
    title = library()[name].title if name in library() and kind != "number" else ""
    if title:
        title = title[0].lower() + title[1:]
    if kind == "left out":
        return f"the simulation leaves out {name} ({title}): {_list(recordings)} in the recordings"
    if kind == "too much":
        return f"the simulation has {name} ({title}), {_list(simulation)}, which the recordings do not show"
    pairs = "; ".join(
        f"{_with_unit(one)} in the simulation, {_with_unit(two)} in the recordings"
        for one, two in zip(simulation, recordings, strict=True)
    )
    what = name if not title else f"{name} ({title})"
    meaning = simulation[0].meaning if not title and simulation else ""
    words = f"{what} ({meaning})" if meaning else what
    far = _percent(simulation, recordings) if relative else ""
    return f"{words} differs: {pairs}{far}"


def _percent(simulation: Sequence[EffectValue], recordings: Sequence[EffectValue]) -> str:
    one, two = simulation[0].value, recordings[0].value
    if not one or not two:
        return ""
    share = 100 * (one / two - 1)
    return f" (the simulation's is {abs(share):.0f} % too {'large' if share > 0 else 'small'})"


def _list(values: Sequence[EffectValue]) -> str:
    return ", ".join(f"{v.name} {_with_unit(v)}" for v in values)


def _with_unit(v: EffectValue) -> str:
    if abs(v.value) >= ABSENT:
        return "none" if v.low is None else f"none (above {v.low:.3g} {v.unit})".replace(" )", ")")
    ends = f" ({v.low:.3g} to {v.high:.3g})" if v.low is not None and v.high is not None else ""
    return f"{v.value:.3g} {v.unit}".rstrip() + ends


def answer_sentence(verdict: Verdict, found: Sequence[Difference], agreement: Sequence[Agreement]) -> str:
    """The answer in one sentence."""
    far = max((a.overall for a in agreement), default=0.0)
    size = f"the difference of a run is at most {far:.2g} times the noise of both"
    if verdict == "agree":
        return f"simulation and recordings agree: {size}"
    if verdict == "differ for an unknown reason":
        part = f"; {_names(found)} explain a part" if found else ""
        return f"simulation and recordings differ, and nothing that is known explains it{part} ({size})"
    said = [
        w.format(_names(some)) for kind, w in _WORDS.items() if (some := [d for d in found if d.kind == kind])
    ]
    return f"simulation and recordings differ: {'; '.join(said)}"


_WORDS: dict[Kind, str] = {
    "instrument": "the instruments differ ({})",
    "number": "other numbers ({})",
    "left out": "the simulation leaves out {}",
    "too much": "the simulation has {} too much",
    "size": "an effect of another size ({})",
}


def _names(found: Sequence[Difference]) -> str:
    return ", ".join(d.name for d in found)
