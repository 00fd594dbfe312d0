"""Sentences of a plan: the answer, what each proposed run adds and why, and the limits that were kept."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.plans.plan_result import Limits, PlannedRun
from rover_sweep.diagnosis.plans.proposals import run_text

if TYPE_CHECKING:
    from rover_sweep.diagnosis.plans.sets import SetResult

DOUBTFUL = 2.0  # separation below which a clearer one is worth a sentence
NAMED = 3  # pairs that a sentence names
SAME = 0.12  # relative; speeds and amplitudes that differ less count as equal
SHARED = "two equal runs differ only by noise, and their common part is the vehicle"
ON_BLOCKS = (
    "the wheel angle is measured against the command to 0.3 deg on one clock, without tyres and body; "
    "enter the lag and delay that it shows in [material] of the vehicle file"
)


def answer(
    now: Sequence[PlannedRun], asked: int, given: SetResult, best: SetResult, added: int
) -> tuple[str, ...]:
    """First what the given runs separate, then what the proposal adds, then the open points."""
    count = "1 run" if added == 1 else f"{added} runs"
    if not now:
        verb = "detects and separates" if added == 1 else "detect and separate"
        return (f"{count} {verb} {separated(asked, best)} of {asked} effects", *_open(best))
    first = f"these runs detect and separate {separated(asked, given)} of {asked} effects"
    if not added:
        return (first, "no run was found that adds to this", *_open(given)) if given.open else (first,)
    more = count.replace("run", "more run")
    return (first, f"with {more} they detect and separate {separated(asked, best)}", *_open(best))


def separated(asked: int, result: SetResult) -> int:
    """Number of effects that are detected near the size that matters and separated from all others."""
    alike = {e for pair in result.look_alikes for e in (pair.first, pair.second)}
    return max(asked - len(set(result.undetectable) | set(result.late) | alike), 0)


def _open(best: SetResult) -> tuple[str, ...]:
    pairs = [f"{p.first} from {p.second}" for p in best.look_alikes[:NAMED]]
    late = [f"{e} ({times:.1f} times)" for e, times in best.late.items()]
    out = [f"not separated: {_listed(pairs)}"] if pairs else []
    out += [f"detected only far above the size that matters: {_listed(late)}"] if late else []
    return tuple(out)


def settles(
    run: PlannedRun, before: Sequence[PlannedRun], without: SetResult | None, with_run: SetResult
) -> str:
    """What a run adds to those before it. without, with_run: results of the set without it and with it."""
    if without is None:
        asked = len(with_run.undetectable | with_run.stacked.sizes.keys())
        return (
            f"{run_text(run)}: as the only run, it detects and separates {separated(asked, with_run)} "
            f"of {asked} effects"
        )
    left = {(p.first, p.second) for p in with_run.look_alikes}
    pairs = [(p.first, p.second) for p in without.look_alikes if (p.first, p.second) not in left]
    detects = sorted(without.undetectable - with_run.undetectable)
    smaller = sorted(set(without.late) - set(with_run.late) - with_run.undetectable)
    parts = [f"detects {_listed(detects)}"] if detects else []
    parts += [f"detects {_listed(smaller)} near the size that matters"] if smaller else []
    if pairs:
        named = [f"{one} from {two}" for one, two in pairs[:NAMED]]
        over = len(pairs) - NAMED
        more = [f"{over} more pair{'s' if over > 1 else ''}"] if over > 0 else []
        parts.append(f"separates {_listed([*named, *more])}")
    elif clearer := _clearer(without, with_run):
        pairs = [clearer]
        parts.append(f"separates {clearer[0]} more clearly from {clearer[1]}")
    if without.noise_unknown and not with_run.noise_unknown:
        parts.append("separates noise from distortion")
    why = _because(run, before, pairs, without.noise_unknown)
    what = "; ".join(parts) or "makes all detectable sizes smaller"
    return f"{run_text(run)}: {what}{f', because {why}' if why else ''}"


def _clearer(without: SetResult, with_run: SetResult) -> tuple[str, str] | None:
    """The doubtful pair whose separation the run improves most."""
    doubtful = {
        pair: clear
        for pair, clear in without.separation.items()
        if clear < DOUBTFUL and pair in with_run.separation
    }
    gain = {pair: with_run.separation[pair] / max(clear, 0.1) for pair, clear in doubtful.items()}
    best = max(gain, key=lambda pair: gain[pair], default=None)
    return best if best and gain[best] > 1.0 + SAME else None


def _because(
    run: PlannedRun, rest: Sequence[PlannedRun], pairs: Sequence[tuple[str, str]], noise_unknown: bool
) -> str:
    if run.kind == "servo_test":
        return ON_BLOCKS
    if run.kind == "multisine":
        return (
            "its lines without excitation show 2nd and 3rd harmonics at once, and what does not repeat with "
            "its period is noise"
        )
    if any(_alike(run, r) for r in rest):
        return SHARED if noise_unknown else "a repeat makes every detectable size smaller"
    if run.repeat > 1 and noise_unknown:
        return "; ".join(part for part in (_difference(run, rest), SHARED) if part)
    new = _difference(run, rest)
    if run.kind == "bias_sweep":
        about = "effects that are even in the steering show about a bias, where the tyre curve is bent"
        new = f"{about}; {new}" if new else about
    if pairs:
        effect = library()[_by_word(pairs[0], new)]
        return f"{new}{'; ' if new else ''}{effect.title}: {effect.apart}"
    return new


def _difference(run: PlannedRun, rest: Sequence[PlannedRun]) -> str:
    """How the run differs from all the rest."""
    others = [r for r in rest if r.kind != "servo_test"]
    new = []
    if all(abs(run.speed - r.speed) > SAME * r.speed for r in others):
        new.append("it has another speed")
    if all(abs(run.amplitude_us - r.amplitude_us) > SAME * r.amplitude_us for r in others):
        new.append("it has another amplitude")
    if run.kind == "doublet" and not any(r.kind == "doublet" for r in others):
        new.append("its steps show the start of a turn")
    if run.heading is not None and all(r.heading != run.heading for r in others):
        new.append("it has another heading")
    return " and ".join(new)


def _alike(one: PlannedRun, two: PlannedRun) -> bool:
    return (
        one.kind == two.kind
        and abs(one.speed - two.speed) <= SAME * two.speed
        and abs(one.amplitude_us - two.amplitude_us) <= SAME * two.amplitude_us
        and abs(one.bias_us - two.bias_us) <= SAME * one.amplitude_us
        and one.heading in (None, two.heading)
    )


def _by_word(pair: tuple[str, str], new: str) -> str:
    """The effect of a pair whose own explanation names the difference of the run."""
    for effect in pair:
        if any(word in library()[effect].apart for word in ("speed", "amplitude") if word in new):
            return effect
    return pair[0]


def notes(outside: Sequence[PlannedRun], limits: Limits) -> tuple[str, ...]:
    """The limits that the proposal keeps, and the given runs that exceed them."""
    kept = (
        f"proposed runs stay within {limits.ay:.1f} m/s^2 of lateral acceleration ({limits.why}), "
        f"{limits.amplitude_us:g} us, and {limits.speed[0]:g} to {limits.speed[1]:g} m/s"
    )
    return (
        kept,
        *(f"the {run_text(run)} exceeds these limits, so its result is not reliable" for run in outside),
    )


def _listed(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}" if parts else ""
