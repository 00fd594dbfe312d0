"""A plan in sentences: the answer, what each proposed run settles and why, what was kept within."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.plans.plan_result import Limits, PlannedRun
from rover_sweep.diagnosis.plans.proposals import words

if TYPE_CHECKING:
    from rover_sweep.diagnosis.plans.sets import Seen

DOUBT = 2.0  # of what tells a pair apart, below which it is worth more
TOLD = 3  # pairs that a sentence names
SAME = 0.12  # relative; speeds and amplitudes that differ less count as one
SHARED = "what differs between two equal runs is noise, and what they share is the vehicle"
ON_BLOCKS = (
    "the wheel's angle is measured against the command to 0.3 deg on one clock, without tyres and body; "
    "what it shows of lag and delay goes into [material] of the vehicle file"
)


def answer(now: Sequence[PlannedRun], asked: int, seen: Seen, best: Seen, added: int) -> tuple[str, ...]:
    """First what the runs tell, then what the proposal adds, then what stays open."""
    count = "1 run" if added == 1 else f"{added} runs"
    if not now:
        first = f"{count} find {told(asked, best)} of {asked} effects in time and tell them from all others"
        return (first, *_left(best))
    first = f"these runs find {told(asked, seen)} of {asked} effects in time and tell them from all others"
    if not added:
        return (first, "no run was found that would tell more", *_left(seen)) if seen.open else (first,)
    more = count.replace("run", "more run")
    return (first, f"with {more} it would be {told(asked, best)}", *_left(best))


def told(asked: int, seen: Seen) -> int:
    """Effects that are found in time and told from all others."""
    alike = {e for pair in seen.apart for e in (pair.first, pair.second)}
    return max(asked - len(set(seen.blind) | set(seen.late) | alike), 0)


def _left(best: Seen) -> tuple[str, ...]:
    left = [f"{p.first} from {p.second}" for p in best.apart[:TOLD]]
    late = [f"{e} ({times:.1f} times)" for e, times in best.late.items()]
    out = [f"not told apart stay {_listed(left)}"] if left else []
    out += [f"found only far beyond the size at which it counts: {_listed(late)}"] if late else []
    return tuple(out)


def settles(run: PlannedRun, before: Sequence[PlannedRun], without: Seen | None, beside: Seen) -> str:
    """What a run settles beside those before it; without, beside: what the set shows less it and with it."""
    if without is None:
        asked = len(beside.blind | beside.stacked.sizes.keys())
        return f"{words(run)}: by itself finds {told(asked, beside)} of {asked} effects in time"
    left = {(p.first, p.second) for p in beside.apart}
    pairs = [(p.first, p.second) for p in without.apart if (p.first, p.second) not in left]
    shows = sorted(without.blind - beside.blind)
    sooner = sorted(set(without.late) - set(beside.late) - beside.blind)
    parts = [f"shows {_listed(shows)}"] if shows else []
    parts += [f"finds {_listed(sooner)} in time"] if sooner else []
    if pairs:
        named = [f"{one} from {two}" for one, two in pairs[:TOLD]]
        over = len(pairs) - TOLD
        more = [f"{over} more pair{'s' if over > 1 else ''}"] if over > 0 else []
        parts.append(f"tells {_listed([*named, *more])}")
    elif helped := _helped(without, beside):
        pairs = [helped]
        parts.append(f"tells {helped[0]} more surely from {helped[1]}")
    if without.noisy and not beside.noisy:
        parts.append("tells noise from distortion")
    why = _because(run, before, pairs, without.noisy)
    what = ", and ".join(parts) or "makes all sizes smaller"
    return f"{words(run)}: {what}{f', because {why}' if why else ''}"


def _helped(without: Seen, beside: Seen) -> tuple[str, str] | None:
    """The pair in doubt that the run does most for."""
    doubtful = {pair: sure for pair, sure in without.sure.items() if sure < DOUBT and pair in beside.sure}
    gain = {pair: beside.sure[pair] / max(sure, 0.1) for pair, sure in doubtful.items()}
    best = max(gain, key=lambda pair: gain[pair], default=None)
    return best if best and gain[best] > 1.0 + SAME else None


def _because(
    run: PlannedRun, rest: Sequence[PlannedRun], pairs: Sequence[tuple[str, str]], noisy: bool
) -> str:
    if run.kind == "servo_test":
        return ON_BLOCKS
    if run.kind == "multisine":
        return (
            "its even and odd lines that are not driven show 2nd and 3rd harmonics at once, and what does "
            "not repeat with its periods is noise"
        )
    if any(_like(run, r) for r in rest):
        return SHARED if noisy else "the same again makes every size smaller"
    if run.repeat > 1 and noisy:
        return "; ".join(part for part in (_new(run, rest), SHARED) if part)
    new = _new(run, rest)
    if run.kind == "bias_sweep":
        about = "what is even about straight shows about a bias, and tyres are bent there"
        new = f"{about}; {new}" if new else about
    if pairs:
        effect = library()[_by_word(pairs[0], new)]
        return f"{new}{'; ' if new else ''}{effect.title}: {effect.apart}"
    return new


def _new(run: PlannedRun, rest: Sequence[PlannedRun]) -> str:
    """In what the run differs from all the rest."""
    others = [r for r in rest if r.kind != "servo_test"]
    new = []
    if all(abs(run.speed - r.speed) > SAME * r.speed for r in others):
        new.append("it has another speed")
    if all(abs(run.amplitude_us - r.amplitude_us) > SAME * r.amplitude_us for r in others):
        new.append("it has another amplitude")
    if run.kind == "doublet" and not any(r.kind == "doublet" for r in others):
        new.append("its steps show the beginning of a turn")
    if run.heading is not None and all(r.heading != run.heading for r in others):
        new.append("it goes another way")
    return " and ".join(new)


def _like(one: PlannedRun, two: PlannedRun) -> bool:
    return (
        one.kind == two.kind
        and abs(one.speed - two.speed) <= SAME * two.speed
        and abs(one.amplitude_us - two.amplitude_us) <= SAME * two.amplitude_us
        and abs(one.bias_us - two.bias_us) <= SAME * one.amplitude_us
        and one.heading in (None, two.heading)
    )


def _by_word(pair: tuple[str, str], new: str) -> str:
    """The effect of a pair whose own explanation speaks of what is new."""
    for effect in pair:
        if any(word in library()[effect].apart for word in ("speed", "amplitude") if word in new):
            return effect
    return pair[0]


def notes(beyond: Sequence[PlannedRun], limits: Limits) -> tuple[str, ...]:
    """What was kept within, and runs of the user's that are not."""
    kept = (
        f"no run is proposed beyond {limits.ay:.1f} m/s^2 of lateral acceleration ({limits.why}), "
        f"{limits.amplitude_us:g} us, or outside {limits.speed[0]:g} to {limits.speed[1]:g} m/s"
    )
    doubt = "is beyond these limits: what it would show is not to be relied on"
    return (kept, *(f"the {words(run)} {doubt}" for run in beyond))


def _listed(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}" if parts else ""
