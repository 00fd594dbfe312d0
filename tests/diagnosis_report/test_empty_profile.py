"""A place of mismatch along which nothing was known."""

from __future__ import annotations

from dataclasses import replace

from fabricated_diagnoses import OVERLAYS

from rover_sweep.diagnosis.result import Mismatch, Profile
from rover_sweep.report.charts.diagnosis_charts import drawable, mismatch_chart

PLACE = Mismatch(
    "r", (0.0, 1.0), "heading south", 1.6, "r differs heading south", Profile("heading", "", (), ())
)


def test_an_empty_profile_gives_way_to_the_frequencies_or_to_no_picture() -> None:
    own = [replace(OVERLAYS[0], channel="r")]
    assert drawable(PLACE, own) and not drawable(PLACE, [])
    (stack,) = mismatch_chart(PLACE, own).stacks
    assert stack.panels[0].lines and "rad/s" in stack.x_label
