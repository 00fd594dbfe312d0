"""The season's page and the charts of a comparison hold their numbers."""

from __future__ import annotations

import json
import re
from typing import Any

import numpy as np

from rover_sweep.comparison.answer import Bode
from rover_sweep.report.charts.diagnosis_charts import bode_chart
from rover_sweep.report.in_html import in_html
from rover_sweep.report.season_report import vehicle_report
from rover_sweep.season.season_result import DayValue, TrackedQuantity, VehicleSeason


def test_a_vehicles_page_has_a_chart_of_each_quantity() -> None:
    days = ("2026-05-01", "2026-05-02", "2026-05-04")
    numbers: dict[str, Any] = {"value": 3.0, "low": 2.5, "high": 3.5, "fitted": 3.0}
    values = tuple(DayValue(day=day, **numbers) for day in days)
    quantity = TrackedQuantity("Cf", "N/rad", "stiffness", 0.1, values)
    vehicle = VehicleSeason("red", dict.fromkeys(days, ("a.BIN",)), {}, (quantity,))
    html = in_html(vehicle_report(vehicle, {}))
    found = re.search(r'<script type="application/json">(.*?)</script>', html, re.S)
    assert found
    (stack,) = json.loads(found[1])["stacks"]
    assert stack["kind"] == "date" and stack["title"] == "Cf, N/rad"
    assert stack["span"][1] - stack["span"][0] == 5 * 86400


def test_responses_of_a_comparison_are_in_db() -> None:
    w = np.array([1.0, 2.0, 5.0])
    h = np.array([1.0, 10.0, 1j])
    chart = bode_chart([Bode("run", True, "r", w, h, 2 * h, h, np.ones(3), (1.0, 5.0))])
    magnitude, phase, coherence = chart.stacks[0].panels
    np.testing.assert_allclose(magnitude.lines[0].y, [0, 20, 0], atol=1e-9)
    np.testing.assert_allclose(phase.lines[0].y, [0, 0, 90], atol=1e-9)
    assert coherence.label == "coherence"
