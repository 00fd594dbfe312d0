"""The study's folder: study.json, study.html, figures/*.png."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rover_sweep.files.replaced import write_file
from rover_sweep.report.charts.shown_chart import ShownChart, by_section, png_source
from rover_sweep.report.pictures.drawing_processes import pngs
from rover_sweep.report.templates import environment
from rover_sweep.report.wording.provenance import versions
from rover_sweep.report.wording.strict_json import strict_json
from rover_sweep.study.conditions import Progress
from rover_sweep.study.figures import figures
from rover_sweep.study.findings import StudyFinding
from rover_sweep.study.overview import outcome_counts, rover_sentences
from rover_sweep.study.published import PAPER
from rover_sweep.study.published_tables import (
    cost_comparison,
    parameter_comparison,
    practices_table,
    verifications,
)
from rover_sweep.study.study_json import study_document
from rover_sweep.study.virtual_study import Study


@dataclass(frozen=True)
class StudyFiles:
    """Paths of the written files."""

    document: Path
    page: Path
    figures: tuple[Path, ...]


def write_study(
    study: Study, found: tuple[StudyFinding, ...], directory: Path, progress: Progress
) -> StudyFiles:
    """Writes all files, each replaced atomically. UsageError if the directory cannot be written."""
    document = write_file(directory / "study.json", strict_json(study_document(study, found)))
    plan, drawn = tuple(figures(study)), []
    made = pngs(plan)
    for k, picture in enumerate(plan):
        progress(k / len(plan), f"drawing {picture.name}")
        drawn.append((picture, next(made)))
    paths = tuple(write_file(directory / "figures" / f"{p.name}.png", data) for p, data in drawn)
    shown = [ShownChart(p.section, p.caption, source=png_source(data)) for p, data in drawn]
    page = write_file(directory / "study.html", _page(study, found, shown))
    return StudyFiles(document, page, paths)


def _page(study: Study, found: tuple[StudyFinding, ...], pictures: list[ShownChart]) -> str:
    return (
        environment("study")
        .get_template("study.html.j2")
        .render(
            study=study,
            paper=PAPER,
            versions=versions(),
            findings=found,
            summary=outcome_counts(found),
            rover=rover_sentences(study),
            ways=practices_table(study),
            costs=cost_comparison(study),
            parameters=[parameter_comparison(study, m) for m in ("bicycle", "roll-yaw", "lumped")],
            verifications=list(verifications(study)),
            pictures=by_section(pictures),
        )
    )
