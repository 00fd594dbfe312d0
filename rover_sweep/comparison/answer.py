"""The result of a comparison as frozen values; `rover_sweep.report` writes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from rover_sweep.data.recording import Array
from rover_sweep.data.result_table import ShortTable, Shown, plain_number
from rover_sweep.diagnosis.result import EffectValue, Mismatch, Overlay, UpperBound
from rover_sweep.spectra.exponentials import Complex

Kind = Literal["instrument", "number", "left out", "too much", "size"]
"""instrument: of the measurement, no physics. number: same law, other value. left out, too much: physics that
only the recordings or only the simulation have. size: physics of both, in another size."""
Verdict = Literal["agree", "differ", "differ for an unknown reason"]
KINDS: tuple[Kind, ...] = ("instrument", "number", "left out", "too much", "size")


@dataclass(frozen=True)
class Difference:
    """One quantity in which simulation and recordings differ.

    name: of the number or effect. simulation, recordings: its parameters on both sides with 90 % intervals
    and the same names. change: {parameter: simulation to recordings}, a factor where `relative`, else a
    difference. gain: drop of chi-squared. look_alikes: other quantities that explain nearly as much.
    """

    kind: Kind
    name: str
    simulation: tuple[EffectValue, ...]
    recordings: tuple[EffectValue, ...]
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


@dataclass(frozen=True, eq=False)
class Bode:
    """Responses of one run to the steering, of recording and simulation.

    w (n,) [rad/s]; recorded, before, after (n,) complex, SI units; coherence (n,) of the recording; band:
    where it is coherent, None for nowhere.
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

    sentence: the answer. places: where they differ, in sizes of both noise floors together. minor: quantities
    that differ by less than the normal tolerance. could_differ: {effect: {parameter: range}} of the
    differences that these runs do not exclude at 95 %. overlays, bode: `before` is the simulation, `after`
    the simulation plus what the differences change.
    """

    verdict: Verdict
    sentence: str
    places: tuple[Mismatch, ...] = ()
    differences: tuple[Difference, ...] = ()
    minor: tuple[Difference, ...] = ()
    instruments: tuple[Instrument, ...] = ()
    agreement: tuple[Agreement, ...] = ()
    could_differ: Mapping[str, Mapping[str, UpperBound]] = field(default_factory=dict)
    overlays: tuple[Overlay, ...] = ()
    bode: tuple[Bode, ...] = ()
    remarks: tuple[str, ...] = ()
    seconds: float = 0.0

    def table(self) -> ShortTable:
        """The differences with the values of both sides; then each run."""
        rows = []
        for d in (*self.differences, *self.minor):
            for k, (one, two) in enumerate(zip(d.simulation, d.recordings, strict=True)):
                kind = d.kind if d in self.differences else "within tolerance"
                first = (d.name, kind) if k == 0 else ("", "")
                values = (plain_number(one.value, 3), plain_number(two.value, 3))
                interval = f"{plain_number(two.low, 3)} .. {plain_number(two.high, 3)}"
                rows.append((*first, one.name, *values, interval, two.unit))
        runs = ", ".join(f"{a.run} {a.overall:.2f}" for a in self.agreement)
        notes = [f"difference over the noise of both: {runs}", *(i.sentence for i in self.instruments)]
        headings = ("what", "kind", "", "simulation", "recordings", "90 %", "unit")
        return ShortTable(self.sentence, headings, tuple(rows), tuple(notes))
