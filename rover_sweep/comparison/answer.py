"""The result of a comparison as frozen values; `rover_sweep.report` writes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from rover_sweep.data.recording import Array, Complex
from rover_sweep.data.results import ByName, Quantity, ShortTable, Shown, ends_words, plain_number
from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.result import Mismatch, TimeHistory, UpperBound

Kind = Literal["instrument", "number", "left out", "too much", "size"]
"""instrument: of the measurement, no physics. number: same law, other value. left out, too much: physics that
only the recordings or only the simulation have. size: physics of both, in another size."""
Verdict = Literal["agree", "differ", "differ for an unknown reason"]
AGREE = 1.2
"""RMS of a run's difference over the noise of both sides, up to which they agree."""
KINDS: tuple[Kind, ...] = ("instrument", "number", "left out", "too much", "size")


@dataclass(frozen=True)
class Difference:
    """One quantity in which simulation and recordings differ.

    name: of the number or effect. simulation, recordings: its parameters on both sides with 90 % intervals
    and the same names. change: {parameter: simulation to recordings}, a factor if `relative`, else a
    difference. gain: drop of chi-squared. look_alikes: other quantities that explain nearly as much.
    """

    kind: Kind
    name: str
    simulation: ByName[Quantity]
    recordings: ByName[Quantity]
    change: Mapping[str, float]
    relative: bool
    gain: float
    look_alikes: tuple[str, ...]
    sentence: str


@dataclass(frozen=True)
class Instrument:
    """A setting of the measurement that the logs show on both sides: filter, rate or noise of a channel."""

    what: str
    channel: str
    unit: str
    simulation: float | None
    recordings: float | None
    sentence: str


@dataclass(frozen=True)
class Agreement:
    """One run against its simulation: rms over the noise of both, per channel and over all; 1 is agreement.

    held_out: the run was not used to correct the simulation.
    """

    run: str
    simulated: str
    held_out: bool
    overall: float
    channels: Mapping[str, float]

    @property
    def agrees(self) -> bool:
        """True if the run differs by no more than `AGREE`."""
        return self.overall <= AGREE

    @property
    def agrees_everywhere(self) -> bool:
        """True if no channel of the run differs by more either."""
        return self.agrees and all(level <= AGREE for level in self.channels.values())


@dataclass(frozen=True, eq=False)
class Bode:
    """Responses of one run to the steering, of recording and simulation.

    w (n,) [rad/s]; recorded, before, after (n,) complex, SI units; coherence (n,) of the recording; band:
    where it is coherent, else None.
    """

    run: str
    held_out: bool
    output: str
    w: Array
    recorded: Complex
    before: Complex
    after: Complex
    coherence: Array
    band: tuple[float, float] | None


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Shown):
    """Simulation against recordings.

    sentence: the answer. places: where they differ, in units of both noise floors together. minor: quantities
    that differ by less than the normal tolerance. undecided: quantities that the fits of both sides have
    otherwise, where the runs agree all the same. could_differ: {effect: {parameter: range}} of differences
    not excluded at 95 % by these runs. overlays, bode: `before` is the simulation, `after` the simulation
    plus what the differences change.
    """

    verdict: Verdict
    sentence: str
    places: tuple[Mismatch, ...] = ()
    differences: tuple[Difference, ...] = ()
    minor: tuple[Difference, ...] = ()
    undecided: tuple[Difference, ...] = ()
    instruments: tuple[Instrument, ...] = ()
    agreement: tuple[Agreement, ...] = ()
    could_differ: Mapping[str, Mapping[str, UpperBound]] = field(default_factory=dict)
    overlays: tuple[TimeHistory, ...] = ()
    bode: tuple[Bode, ...] = ()
    remarks: tuple[str, ...] = ()
    seconds: float = 0.0

    def table(self) -> ShortTable:
        """The differences with the values of both sides; then each run."""
        rows = []
        others = {"within tolerance": self.minor, "undecided": self.undecided}
        kinds = [(d.kind, d) for d in self.differences]
        kinds += [(words, d) for words, some in others.items() for d in some]  # type: ignore[misc]
        for kind, d in kinds:
            for k, (one, two) in enumerate(zip(d.simulation, d.recordings, strict=True)):
                first = (d.name, kind) if k == 0 else ("", "")
                values = (plain_number(one.value, 3), plain_number(two.value, 3))
                interval = ends_words(two.low, two.high)
                rows.append((*first, one.name, *values, interval, two.unit))
        runs = ", ".join(f"{a.run} {a.overall:.2f}" for a in self.agreement)
        notes = [f"difference over the noise of both: {runs}", *(i.sentence for i in self.instruments)]
        headings = ("what", "kind", "", "simulation", "recordings", "90 %", "unit")
        return ShortTable(self.sentence, headings, tuple(rows), tuple(notes))


# The words of a comparison.


ABSENT = 1e5  # a limit or a cut-off at or above this does not exist


def difference_sentence(
    kind: Kind, name: str, simulation: Sequence[Quantity], recordings: Sequence[Quantity], relative: bool
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


def _percent(simulation: Sequence[Quantity], recordings: Sequence[Quantity]) -> str:
    one, two = simulation[0].value, recordings[0].value
    if not one or not two:
        return ""
    share = 100 * (one / two - 1)
    return f" (the simulation's is {abs(share):.0f} % too {'large' if share > 0 else 'small'})"


def _list(values: Sequence[Quantity]) -> str:
    return ", ".join(f"{v.name} {_with_unit(v)}" for v in values)


def _with_unit(v: Quantity) -> str:
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


# A corrected simulation as frozen values; `rover_sweep.twin` makes it, `rover_sweep.report` writes it.


@dataclass(frozen=True)
class Correction:
    """One entry of a variant file that was changed.

    entry: a number's name, or "effects.<id>". before, after: as text, "" for an effect that is not there.
    recordings: their value with its 90 % interval, as text. reason: one sentence. unit: of a number, or of
    each parameter of an effect.
    """

    entry: str
    before: str
    after: str
    recordings: str
    reason: str
    unit: str = ""


@dataclass(frozen=True, eq=False)
class TwinDrive:
    """One drive of the simulation: its comparison, and the corrections after it.

    simulator: "plant", "embedded" or "ardurover".
    """

    comparison: Comparison
    corrections: tuple[Correction, ...] = ()
    simulator: str = "plant"


@dataclass(frozen=True, eq=False)
class Twin:
    """A simulation that was compared, corrected and driven again until it agreed or nothing helped.

    agrees: the last round agrees. corrections: of all rounds together, from the first variant to the last.
    left: sentences on differences that the simulated rover cannot have. overlays, bode: the first and the
    last simulation.
    """

    sentence: str
    agrees: bool
    rounds: tuple[TwinDrive, ...]
    corrections: tuple[Correction, ...] = ()
    left: tuple[str, ...] = ()
    overlays: tuple[TimeHistory, ...] = ()
    bode: tuple[Bode, ...] = ()
    remarks: tuple[str, ...] = ()
    variant: str = ""
    """Text of the corrected variant file."""
    seconds: float = field(default=0.0)
