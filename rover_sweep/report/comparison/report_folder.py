"""The folders of a comparison and of a corrected simulation."""

from __future__ import annotations

from pathlib import Path

from rover_sweep.comparison.answer import Comparison
from rover_sweep.comparison.corrected import Twin
from rover_sweep.files.replaced import write_file
from rover_sweep.report.comparison.comparison_json import comparison_document, twin_document
from rover_sweep.report.wording.provenance import Provenance
from rover_sweep.report.wording.strict_json import strict_json

PREDICTED = "the simulation plus what the differences change"
AGAIN = "the corrected simulation, driven again"


def write_comparison(found: Comparison, directory: Path, provenance: Provenance) -> Path:
    """Write comparison.html and comparison.json; the path of the page. UsageError if it is not writable."""
    from rover_sweep.report.comparison.page import comparison_page
    from rover_sweep.report.comparison.pictures import planned_pictures
    from rover_sweep.report.pictures.drawn_pictures import drawn_pictures

    plan = planned_pictures(found.overlays, found.bode, PREDICTED)
    pictures = drawn_pictures(plan)
    page = comparison_page(found, provenance, pictures)
    document = strict_json(comparison_document(found, provenance))
    html = write_file(directory / "comparison.html", page)
    write_file(directory / "comparison.json", document)
    return html


def write_twin(found: Twin, directory: Path, provenance: Provenance) -> Path:
    """Write twin.html, variant.toml and twin.json; the path of the page."""
    from rover_sweep.report.comparison.page import twin_page
    from rover_sweep.report.comparison.pictures import planned_pictures
    from rover_sweep.report.pictures.drawn_pictures import drawn_pictures

    plan = planned_pictures(found.overlays, found.bode, AGAIN)
    pictures = drawn_pictures(plan)
    page = twin_page(found, provenance, pictures)
    document = strict_json(twin_document(found, provenance))
    write_file(directory / "variant.toml", found.variant)
    html = write_file(directory / "twin.html", page)
    write_file(directory / "twin.json", document)
    return html
