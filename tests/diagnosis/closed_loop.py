"""`python -m tests.diagnosis.closed_loop SETS`: whether a diagnosis and the comparison agree with each other.

Each set is diagnosed. Its model drives two runs again, as the simulated rover that `diagnose` writes: once
whole, once without the effects that were found. The whole one must agree with the recordings; without
effects that were named it must differ, by the same names. A verdict "agree" with a channel that lies beyond
the limit, or another one where all lie within it, contradicts its own table.
SETS: as in `tests.diagnosis.flips`, folders only.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

from click.testing import CliRunner

import rover_sweep as rs
from rover_sweep.cli.main import cli
from rover_sweep.comparison.answer import Comparison
from rover_sweep.data.recording import Recording
from rover_sweep.diagnosis.effects import every_form
from rover_sweep.diagnosis.result import Diagnosis
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.report.export.plant_variant import variant_text
from tests.diagnosis.flips import case_of, sets

RUNS = (1, 3)  # driven again; as a user would, not all


@dataclass(frozen=True)
class Loop:
    """A set's outcome. whole, bare: verdict of the comparison with the simulated rover with and without its
    effects, "" where there is none. named: effects of the diagnosis; seen: in which `bare` differs.
    contradictions: of a verdict and its table, in words."""

    name: str
    verdict: str
    named: frozenset[str]
    whole: str
    largest: float
    bare: str
    seen: frozenset[str]
    contradictions: tuple[str, ...]

    @property
    def line(self) -> str:
        """The outcome in one line."""
        found = f"{self.name}: {self.verdict} {', '.join(sorted(self.named)) or '-'}"
        both = f"{self.whole} ({self.largest:.2f} of the noise)"
        rest = f"; without it: {self.bare}, in {', '.join(sorted(self.seen)) or '-'}" if self.bare else ""
        return "; ".join((f"{found}: {both}{rest}", *self.contradictions))


def loop_of(name: str) -> Loop:
    """The closed loop of one set."""
    with tempfile.TemporaryDirectory() as out:
        case = case_of(name, Path(out))
        folder, held = Path(case.folder), list(case.held_out)
        found = rs.diagnose(case.runs, held)
        assert found.model is not None
        named = frozenset(f.effect for f in found.findings)
        whole = _compared(case.runs, held, found, found.model, folder, Path(out) / "whole")
        bare, seen = None, frozenset[str]()
        if named:
            bare = _compared(case.runs, held, found, without_effects(found.model), folder, Path(out) / "bare")
            seen = frozenset(_effect_of(d.name, named) for d in bare.differences)
        both = [c for c in (whole, bare) if c is not None]
        largest = max(a.overall for a in whole.agreement)
        said = bare.verdict if bare else ""
        wrong = tuple(w for c in both for w in contradictions(c))
        return Loop(case.name, found.verdict, named, whole.verdict, largest, said, seen, wrong)


def without_effects(model: AugmentedModel) -> AugmentedModel:
    """The baseline alone, with normal values of the numbers that the effects release."""
    x, simulated = dict(model.x), model.simulated
    for law in model.added:
        simulated = simulated.without(law.id)
        x |= {c.name: c.start for c in simulated.free if c.name in law.releases}
    return replace(model, effects=simulated.effects, x=x, laws=())


def _effect_of(difference: str, named: frozenset[str]) -> str:
    """The named effect that has the number in which two sides differ, or the difference's own name."""
    laws = [law for law in every_form().values() if law.id in named]
    return next((law.id for law in laws if difference in law.releases), difference)


def contradictions(found: Comparison) -> Iterator[str]:
    """Where the verdict of a comparison says other than its table."""
    everywhere = all(a.agrees_everywhere for a in found.agreement)
    if (found.verdict == "agree") and not all(a.agrees for a in found.agreement):
        yield "CONTRADICTION: agrees, and a run does not"
    if everywhere and found.verdict != "agree":
        yield f"CONTRADICTION: {found.verdict}, and all runs agree in all channels"


def _compared(
    runs: rs.Runs, held: list[Recording], found: Diagnosis, model: AugmentedModel, folder: Path, out: Path
) -> Comparison:
    out.mkdir()
    variant = out / "variant.toml"
    variant.write_text(variant_text(model), encoding="utf-8")
    again = [out / f"run{k}.BIN" for k in RUNS]
    for k, target in zip(RUNS, again, strict=True):
        given = ["redrive", str(folder / f"run{k}.BIN"), "--variant", str(variant), "--out", str(target)]
        done = CliRunner().invoke(cli, given)
        assert done.exit_code == 0, done.output
    simulated = rs.read(*again, vehicle=folder / "rover.toml")
    return rs.compare(runs, list(simulated), held, diagnosis=found)


def main() -> None:
    """Prints each set, then the counts; exit code 1 where a verdict contradicts its table."""
    parser = argparse.ArgumentParser(prog="python -m tests.diagnosis.closed_loop", description=__doc__)
    parser.add_argument("sets", nargs="+", metavar="SETS")
    parser.add_argument("--jobs", type=int, default=1, help="sets at a time")
    args = parser.parse_args()
    loops = []
    with ProcessPoolExecutor(args.jobs) as pool:
        for loop in pool.map(loop_of, sets(args.sets)):
            print(loop.line, flush=True)
            loops.append(loop)
    hiding = [x for x in loops if x.named]
    wrong = [x for x in loops if x.contradictions]
    print(f"agree: {sum(x.whole == 'agree' for x in loops)} of {len(loops)}")
    print(f"without the effects found, it differs: {sum(x.bare != 'agree' for x in hiding)} of {len(hiding)}")
    print(f"  and by the same names: {sum(x.seen == x.named for x in hiding)}")
    print(f"contradictions: {len(wrong)}")
    raise SystemExit(1 if wrong else 0)


if __name__ == "__main__":
    main()
