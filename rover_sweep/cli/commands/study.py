"""`rover-sweep study`: the paper's comparison of three model structures, repeated on a virtual rover."""

from __future__ import annotations

from pathlib import Path

import click

from rover_sweep.cli.options import FOLDER, SEED, check_writable, option, options


@click.command()
@options
def study(
    out: str = option("Folder for tables, figures and page; created if missing.", FOLDER, required=True),
    seed: int = SEED,
    as_json: bool = option("Print study.json on stdout; tables go to stderr.", flag="--json"),
) -> None:
    """Repeat the comparison of Ivler, Gowans and Marfise (2022) on a virtual rover with their numbers.

    Drives the sweeps of Table 1 and doublets on asphalt, on artificial grass and at 4 m/s, and identifies
    the bicycle, roll-yaw and lumped models. Compares Tables 2 to 7 and Figures 2, 3, 6, 7 and 8 with the
    published ones and comments on each finding. No hardware; about half a minute.
    """
    from rover_sweep.cli.views.asking import long_work
    from rover_sweep.cli.views.output import echo_json, results, say_next
    from rover_sweep.report.on_terminal import on_terminal
    from rover_sweep.study.study_folder import all_findings, study_report, write_study
    from rover_sweep.study.virtual_study import study as run

    check_writable(Path(out))
    console = results(as_json)
    with long_work("the study") as report:
        result = run(seed, lambda step, share: report(step, 0.75 * share))
        found = all_findings(result)
        document, page = write_study(
            result, found, Path(out), lambda step, share: report(step, 0.75 + 0.25 * share)
        )
    console.print(on_terminal(study_report(result, found), answer_last=True))
    console.print(f"study: {page}", soft_wrap=True)
    say_next("rover-sweep dry-run")
    if as_json:
        echo_json(document.read_text(encoding="utf-8"))
