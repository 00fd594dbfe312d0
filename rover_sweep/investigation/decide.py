"""The next step of an investigation: settled, used up, or one more run with the reason for it.

The smallest first set is one sweep, which shows most effects, and one doublet, which is held out and confirms
what the sweep shows. After that every run answers an open question of the diagnosis: the plan says which run
is expected to tell most about the explanations at hand.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rover_sweep.diagnosis.plans.next_run import Odds, RunValue, effects_of
from rover_sweep.diagnosis.plans.plan import NAMED, in_words
from rover_sweep.diagnosis.plans.plan_result import PlannedRun
from rover_sweep.diagnosis.plans.proposals import run_text
from rover_sweep.diagnosis.result import Diagnosis
from rover_sweep.investigation.next_step import Means, NextStep
from rover_sweep.investigation.open_questions import OpenQuestions, open_questions

CHECK = 0.6  # amplitude of the doublet over that of the sweep
SAME = 0.12  # relative; amplitudes and speeds that differ less count as equal
Ranking = Callable[[Odds], Sequence[RunValue]]
"""The choices that are worth their drive for these odds, the best first."""


def first_run(driven: Sequence[PlannedRun], first: PlannedRun, means: Means) -> NextStep | None:
    """The next run of the smallest first set, None if the set is driven. first: its sweep."""
    shown = [run for run in driven if run.kind != "doublet"]
    if shown and len(shown) < len(driven):
        return None
    if reason := used_up(means):
        return NextStep("used up", reason)
    if not shown:
        return NextStep("drive", f"{run_text(first)}: one sweep shows most effects", (), first)
    run = check(shown)
    return NextStep("drive", f"{run_text(run)}: it is held out, and checks what the sweep shows", (), run)


def check(shown: Sequence[PlannedRun]) -> PlannedRun:
    """The doublet that confirms what these runs show, at the speed of the largest."""
    top = max(shown, key=lambda run: run.amplitude_us)
    return PlannedRun("doublet", 10.0 * round(CHECK * top.amplitude_us / 10.0), round(top.speed, 1))


def next_step(found: Diagnosis, driven: Sequence[PlannedRun], means: Means, ranking: Ranking) -> NextStep:
    """What to do after the diagnosis of the driven runs.

    ranking: called at most once for each question, since it simulates the choices.
    """
    named = tuple(f.effect for f in found.findings)
    if found.verdict == "refused":
        return NextStep("open", f"the runs were refused: {found.sentence}")
    asked = open_questions(found)
    if not asked.why:
        return NextStep("settled", _settled(found), named)
    if reason := used_up(means):
        return NextStep("used up", f"{reason}; {asked.why}", named)
    best = next(iter(ranking(asked.odds)), None)
    if found.verdict == "none" and best is None:
        return NextStep("settled", f"{asked.why}, and no run is expected to tell more about them")
    if best is not None:
        reason = f"{asked.why}; {_purpose(best, asked)}"
        return NextStep("drive", reason, named, best.run, best.bits, asked.odds)
    return _without_ranking(asked, driven, means, named)


def used_up(means: Means) -> str:
    """Why no run can be driven, "" while one can."""
    if means.spent:
        return means.spent
    if means.runs_left <= 0:
        return "all runs that were allowed are driven"
    return "" if means.choices else "no run fits on the ground and within the limits"


def _without_ranking(
    asked: OpenQuestions, driven: Sequence[PlannedRun], means: Means, named: tuple[str, ...]
) -> NextStep:
    """Where the plan knows no run for the question: a test on other data, else another operating point."""
    if asked.unchecked:
        run = check([r for r in driven if r.kind != "doublet"])
        return NextStep("drive", f"{asked.why}; {run_text(run)} is held out and tests it", named, run)
    largest = sorted(means.choices, key=lambda run: -run.amplitude_us)
    new = next((run for run in largest if is_new(run, driven)), None)
    if new is None:
        return NextStep("open", f"{asked.why}, and no run is expected to tell more", named)
    return NextStep("drive", f"{asked.why}; {run_text(new)} shows another amplitude or speed", named, new)


def is_new(run: PlannedRun, driven: Sequence[PlannedRun]) -> bool:
    """True if no driven run has nearly this kind, amplitude and speed."""
    return not any(
        run.kind == other.kind
        and abs(run.amplitude_us - other.amplitude_us) <= SAME * other.amplitude_us
        and abs(run.speed - other.speed) <= SAME * other.speed
        and abs(run.bias_us - other.bias_us) <= SAME * other.amplitude_us
        for other in driven
    )


def _settled(found: Diagnosis) -> str:
    if not found.findings:
        return "no effect is missing, and the bounds of all effects are below the size that matters"
    names = in_words([f.effect for f in found.findings])
    return f"{names}: no look-alike is left, and held-out data confirm it"


def _purpose(best: RunValue, asked: OpenQuestions) -> str:
    """What the run is expected to tell, as part of a sentence."""
    run, bits, names = run_text(best.run), f"({best.bits:.1f} bit expected)", effects_of(asked.odds)
    if best.settles:
        return f"{run} is expected to settle it if {in_words(best.settles, 'or')} is true {bits}"
    return f"{run} tells most about {in_words(names) if len(names) <= NAMED else 'them'} {bits}"
