"""Identify models, write the report and print the comparison: for `identify`, `run` and `dry-run`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import RenderableType

    from rover_sweep.data.recording import Recording
    from rover_sweep.data.vehicle_file import Vehicle
    from rover_sweep.identification.grouping import Settings
    from rover_sweep.identification.model_results import ModelResult
    from rover_sweep.identification.pipeline import Identification
    from rover_sweep.identification.structure.state_space import ModelStructure


def show_identified(
    sweeps: tuple[Recording, ...],
    checks: tuple[Recording, ...],
    rover: tuple[Vehicle, Path],
    settings: Settings,
    out: Path,
    as_json: bool,
    full: bool = False,
    more: Callable[[Identification], RenderableType] | None = None,
    structures: Sequence[ModelStructure] = (),
    units: str = "SI",
) -> None:
    """Identify, print the answer and `more`, write the report into `out`, print its path.

    full: all tables before the answer. structures: the user's own. units: of accelerations, "SI" or
    "paper". as_json: identification.json on stdout, everything else on stderr.
    """
    from rover_sweep.api.identify import identified as identified_models
    from rover_sweep.cli.views.long_work import long_work
    from rover_sweep.cli.views.output import echo_json, narration, print_warnings, results
    from rover_sweep.report.identification.terminal import comparison, conclusion, first_numbers, short_answer
    from rover_sweep.report.wording.shown_units import SHOWN_UNITS

    console, shown = narration(), results(as_json)
    print_warnings(console, (*sweeps, *checks))
    command = " ".join(["rover-sweep", *sys.argv[1:]])
    with long_work(f"identifying from {len(sweeps)} run{'s' if len(sweeps) != 1 else ''}") as work:

        def show_first(models: Mapping[str, ModelResult]) -> None:
            if settings.bootstrap and (words := first_numbers(models)):
                work.tell(words)

        result = identified_models(
            sweeps, checks, rover, settings, structures, command=command, fitted=show_first
        )
    if full:
        shown.print(comparison(result, result.origin, SHOWN_UNITS[units]))
    if more is not None:
        shown.print(more(result))
        shown.print()
    shown.print((conclusion if full else short_answer)(result, result.origin))
    with long_work("writing the report") as progress:
        files = result.report(out, lambda share, what: progress(share, f"writing {what}"), units)
    if not full:
        shown.print("all models, costs and handling: in the report, or here with --full", style="dim")
    shown.print(f"report: {files.page}", soft_wrap=True, markup=False)
    if as_json:
        echo_json(files.document.read_text(encoding="utf-8"))
