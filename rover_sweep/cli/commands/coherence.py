"""`rover-sweep coherence`: a quick check of the runs' coherence while the rover is still in the field."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.options import FILE, POSITIVE, READING, argument, option, options
from rover_sweep.cli.views.output import echo_json, print_table, results, say_next

if TYPE_CHECKING:
    from rover_sweep.api.read import Reading
    from rover_sweep.quality.verdict import CoherenceVerdict


@click.command()
@options
def coherence(
    runs: tuple[str, ...] = argument("RUN...", nargs=-1, required=True),
    reading: Reading = READING,
    vehicle: str | None = option("Vehicle file; gives the tyre friction and the steering sign.", FILE),
    servo: float | None = option("Time of your servo for 60 deg, from its data sheet, s.", POSITIVE, "S"),
    as_json: bool = option("Print the verdicts as JSON on stdout.", flag="--json"),
) -> None:
    """Check whether the coherence of each run is good enough, and say what to change if it is not.

    RUN is a .BIN, a .tlog, a file of another system (.csv, .mcap, ...), log.BIN+log.tlog, or a session's
    folder. No vehicle file is needed. The last table gives the amplitude that the next run needs in each
    octave for a coherence of 0.8 and a random error of 10 %, within the limits of servo, tyres and applet. A
    poor run is not an error: the exit code is 0.
    """
    from rover_sweep.api.read import load_runs
    from rover_sweep.data.vehicle_file import load
    from rover_sweep.quality.faults import each_with_length
    from rover_sweep.quality.verdict import assess

    rover = load(vehicle) if vehicle else None
    found = each_with_length(load_runs(runs, reading.columns, reading.filters, system=reading.system))
    judged = [(run, assess(run, None, rover, servo)) for run in found]
    if not as_json:
        for run, verdict in judged:
            _show(verdict, [note.text for note in run.notes if note.level == "warning"])
        if all(verdict.keep for _, verdict in judged):
            given = shlex.join([*runs, *(("--vehicle", vehicle) if vehicle else ())])
            say_next(f"rover-sweep identify {given} --out report")
        else:
            say_next("drive again what is not kept, with the amplitude above")
        return
    document: list[dict[str, Any]] = [asdict(verdict) | {"keep": verdict.keep} for _, verdict in judged]
    for entry, (run, verdict) in zip(document, judged, strict=True):
        entry["notes"] = [asdict(note) for note in run.notes]
        bands = [{k: x for k, x in asdict(b).items() if x != float("inf")} for b in verdict.next.bands]
        names = ("amplitude", "w_max", "sentence")
        entry["next"] = {**{name: getattr(verdict.next, name) for name in names}, "bands": bands}
    echo_json(json.dumps(document, indent=2))


def _show(verdict: CoherenceVerdict, warnings: Sequence[str]) -> None:
    """Print one run: verdict, warnings on the recording, a row per response, the next amplitude."""
    from rich.text import Text

    console = results()
    sentence = (verdict.sentence, "green" if verdict.keep else "yellow")
    console.print(Text.assemble((verdict.run, "bold"), ": ", sentence), soft_wrap=True)
    for warning in warnings:
        console.print(f"warning: {warning}", style="yellow", soft_wrap=True)
    if verdict.outputs:
        rows = []
        for o in verdict.outputs:
            band = f"{o.band[0]:.2g} - {o.band[1]:.3g}" if o.band else "none"
            rows.append((o.output, band, f"{100 * o.covered:.0f} %", f"{o.lowest:.2f} at {o.lowest_at:.2g}"))
        print_table(console, ("response", "usable band, rad/s", "range at >= 0.6", "lowest coherence"), rows)
    if verdict.next.bands:
        console.print(f"next amplitude: {verdict.next.sentence}", soft_wrap=True)
        unit = verdict.amplitude_unit
        needs = []
        for b in verdict.next.bands:
            amplitude = f"{'>= ' if b.drowned else ''}{b.amplitude:{'.0f' if unit == 'us' else '.2g'}}"
            texts = (f"{b.low:.2g} - {b.high:.3g}", b.response, f"{b.coherence:.2f}", amplitude)
            needs.append((*texts, f"{b.reached:.2f}", b.cap))
        headings = ("rad/s", "needed by", "coherence", f"amplitude, {unit}", "expected then", "limited by")
        print_table(console, headings, needs, text_columns=(0, 1, 5))
