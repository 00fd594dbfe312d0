"""One trial of a recording as a source: `runs.csv:3` is trial 3 of runs.csv.

The label is the value in the column of `trial`, or the number of the run where the file has no such column. A
trial in which several runs were found gives all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rover_sweep.data.recording import Recording
from rover_sweep.errors import UsageError


@dataclass(frozen=True)
class TrialSource:
    """A source and the label of its only trial; "" for all trials."""

    source: str
    label: str = ""

    def chosen(self, runs: Sequence[Recording]) -> list[Recording]:
        """The runs of this trial; UsageError with the labels of the file where there is none."""
        if not self.label:
            return list(runs)
        found = [run for run in runs if _is_of(self.label, self._rest(run))]
        found = found or [run for run in runs if _is_of(f"run {self.label}", self._rest(run))]
        if not found:
            have = ", ".join(dict.fromkeys(rest for run in runs if (rest := self._rest(run))))
            many = f"its trials with a run are {have}" if have else "it has only one run; give it as a whole"
            raise UsageError(f"{Path(self.source).name} has no trial {self.label!r}: {many}")
        return found

    def without(self, others: Sequence[TrialSource], runs: Sequence[Recording]) -> list[Recording]:
        """The runs without the trials of this file that are named among other sources."""
        same = [o for o in others if o.label and Path(o.source).resolve() == Path(self.source).resolve()]
        if self.label or not same:
            return list(runs)
        taken = {id(run) for other in same for run in other.chosen(runs)}
        return [run for run in runs if id(run) not in taken]

    def _rest(self, run: Recording) -> str:
        """A run's name after that of its file."""
        return run.name.removeprefix(Path(self.source).stem).strip()


def trial_source(given: str) -> TrialSource:
    """The source and its trial; a colon that belongs to the name of an existing file names no trial."""
    source, colon, label = given.rpartition(":")
    if colon and label.strip() and not Path(given).exists() and Path(source).expanduser().is_file():
        return TrialSource(source, label.strip())
    return TrialSource(given)


def sources_without(sources: Sequence[str], apart: Sequence[str]) -> list[str]:
    """The sources without the whole files in `apart`; its trials are left out when their file is read.

    UsageError for a part of none of the sources: it would stay in the fit.
    """
    places = {given: Path(trial_source(given).source).resolve() for given in (*sources, *apart)}
    for given in apart:
        if places[given] not in {places[s] for s in sources}:
            raise UsageError(f"without: {given} is not among what is read ({', '.join(sources)})")
    whole = {places[given] for given in apart if not trial_source(given).label}
    kept = [s for s in sources if places[s] not in whole]
    if not kept:
        raise UsageError("without leaves out everything that is read; leave some")
    return kept


def _is_of(label: str, rest: str) -> bool:
    """True where the rest of a run's name begins with a label; numbers are equal by value, 3 and 3.0."""
    if rest == label or rest.startswith(f"{label} "):
        return True
    try:
        return float(rest.partition(" ")[0]) == float(label)
    except ValueError:
        return False
