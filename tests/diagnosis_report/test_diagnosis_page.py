"""diagnosis.html: the answer first, every finding, nothing from elsewhere; the pictures."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from fabricated_diagnoses import ALL, EXPLAINED, MISMATCHES, NONE, OVERLAYS, PARTLY

from rover_sweep.data.recording import Note, Recording
from rover_sweep.diagnosis.result import Diagnosis, Profile, Unseen, UpperBound
from rover_sweep.report.charts.chart import ChartPlan
from rover_sweep.report.charts.diagnosis_charts import drawable, mismatch_chart, overlay_chart
from rover_sweep.report.charts.static_svg import svg
from rover_sweep.report.diagnosis.diagnosis_json import DiagnosisOrigin
from rover_sweep.report.diagnosis.report import diagnosis_report, write_diagnosis
from rover_sweep.report.document import charts_of
from rover_sweep.report.in_html import in_html


def page(found: Diagnosis) -> str:
    return unescape(in_html(diagnosis_report(found, DiagnosisOrigin())))


def planned(found: Diagnosis) -> list[ChartPlan]:
    return list(charts_of(diagnosis_report(found).sections))


@pytest.mark.parametrize("verdict", ALL)
def test_the_answer_comes_first_and_everything_after_it(verdict: str) -> None:
    found, html = ALL[verdict], page(ALL[verdict])
    body = html[html.index('class="answer"') :]
    assert found.sentence[1:] in body and body.index(found.sentence[1:]) < body.index("<h2")
    for f in found.findings:
        assert f.effect in body and f.equation in body and f.sentence[1:] in body and f.next_run[1:] in body
        assert all(e in body for e in f.look_alikes) and all(v.meaning in body for v in f.parameters)
        assert all(h.run in body for h in f.held_out)
    assert all(m.sentence[1:] in body for m in found.mismatch)
    assert all(u.effect in body and u.why in body for u in found.cannot_see)
    assert all(remark[1:] in body for remark in found.remarks)
    if found.unknown:
        assert found.unknown.depends_on in body and found.unknown.law in body


def test_what_was_falsified_and_what_was_not_held_out_stand_in_words() -> None:
    body = page(EXPLAINED)
    row = re.search(r"I_zz</td>.*?</tr>", body)
    assert row and "0.0921" in row[0] and "0.0702" in row[0] and "+31.2" in row[0]
    assert "No run was held out" not in body
    assert "No run was held out" in page(replace(EXPLAINED, held_out=(), held_out_runs=()))


def test_the_warnings_on_recordings_are_there_once() -> None:
    warning = (Note("warning", "several outputs steer"), Note("info", "no standstill"))
    runs = [Recording(f"run{n}", {}, (0.0, 1.0), "sweep", notes=warning) for n in (1, 2, 3)]
    html = in_html(diagnosis_report(NONE, DiagnosisOrigin(recordings=tuple(("fit", run) for run in runs))))
    assert html.count("run1 and 2 more: several outputs steer") == html.count("several outputs steer") == 1
    assert "no standstill" not in html


def test_text_from_elsewhere_is_no_markup() -> None:
    nasty = replace(NONE, sentence="<script>x</script>", remarks=("<b>bold</b>",))
    html = in_html(diagnosis_report(nasty, DiagnosisOrigin()))
    assert "<script>" not in html and "<b>" not in html


def test_the_page_needs_no_other_file(tmp_path: Path) -> None:
    files = write_diagnosis(EXPLAINED, tmp_path, DiagnosisOrigin())
    html = files.page.read_text()
    assert html.count("<figure") == len(planned(EXPLAINED)) and "src=" not in html
    assert "default-src 'none'" in html and not re.search(r"href=\"(?!#)", html)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["diagnosis.html", "diagnosis.json"]


def test_the_pictures_are_those_that_can_be_drawn() -> None:
    names = [p.name for p in planned(EXPLAINED)]
    assert names == ["held-out-0", "mismatch-0", "mismatch-1", "mismatch-2", "fitted-0"]
    place = replace(MISMATCHES[0], profile=Profile("heading", "", (), ()))  # along which nothing was known
    own = [replace(OVERLAYS[0], channel="r")]
    assert drawable(place, own) and not drawable(place, [])
    (stack,) = mismatch_chart(place, own).stacks
    assert stack.panels[0].lines and "rad/s" in stack.x_label
    undrawable = replace(EXPLAINED, overlays=(), scores={})  # the second mismatch has no profile of its own
    assert [p.name for p in planned(undrawable)] == ["mismatch-0", "mismatch-2"]


@pytest.mark.parametrize("found", [EXPLAINED, PARTLY], ids=lambda d: d.verdict)
def test_every_picture_has_its_lines_or_bars(found: Diagnosis) -> None:
    for picture in planned(found):
        chart = picture.make()
        drawn = svg(chart)
        lines = [line for stack in chart.stacks for panel in stack.panels for line in panel.lines]
        assert lines and "NaN" not in drawn and "inf" not in drawn
        assert sum(f'stroke="{line.colour}"' in drawn for line in lines) == len(lines)


def test_the_close_up_is_where_before_and_after_differ_most() -> None:
    o = EXPLAINED.overlays[0]
    after = o.before.copy()
    apart = (o.t > 12.0) & (o.t < 13.0)
    after[apart] += 1.0
    whole, part, _ = overlay_chart((replace(o, after=after),)).stacks
    low, high = part.span
    assert whole.shades[0][:2] == part.span
    assert low <= 12.02 and high >= 12.98 - 1e-9 and high - low < 6.0


def test_gaps_and_missing_spectra_draw_as_well() -> None:
    whole, none = EXPLAINED.overlays[0], np.empty(0)
    gap = whole.before.copy()
    gap[100:120] = np.nan
    holed = replace(whole, before=gap, residual_before=whole.residual_before * np.nan)
    bare = replace(whole, channel="vy", w=none, residual_before=none, residual_after=none, noise=0.0)
    empty = replace(whole, run="run9", t=none, measured=none, before=none, after=none)
    low = replace(EXPLAINED.mismatch[1], band=(0.0, 3.0))
    found = replace(EXPLAINED, overlays=(holed, bare, empty), mismatch=(low,))
    assert [p.name for p in planned(found)] == ["held-out-0"]  # no spectrum of a_y is there
    shaded = replace(EXPLAINED, mismatch=(replace(low, channel="r"),))
    for picture in (*planned(found), planned(shaded)[0]):
        assert "nan" not in svg(picture.make()).lower()


def test_candidates_are_listed_by_their_score_and_those_named_are_marked() -> None:
    scores = {"servo_lag": float("nan"), "roll_steer": -2.0, EXPLAINED.findings[0].effect: 3.0}
    html = page(replace(EXPLAINED, scores=scores))
    rows = re.findall(r"<tr>(.*?)</tr>", html[html.index("All candidates") :])[:3]
    assert EXPLAINED.findings[0].effect in rows[0] and "named" in rows[0]
    assert all(">0</td>" in row for row in rows[1:])


def test_all_bounds_are_in_a_table() -> None:
    bounded = (
        Unseen("roll_steer", "", {"e": UpperBound("-", -0.42, 0.30, 0.04)}, 0.08),
        Unseen("servo_rate_limit", "", {"R": UpperBound("rad/s", 38.0, None, 4.0)}, 0.001, material=False),
    )
    body = page(replace(EXPLAINED, cannot_see=bounded))
    assert "Could still hide (95 %): roll steer of the front axle (-0.42 to 0.30)." in body
    assert "-0.42 to 0.30</td>" in body and "at least 38</td>" in body and "8.0 %" in body


def test_an_unknown_law_is_drawn_with_its_worth_on_the_held_out_run() -> None:
    found = ALL["unexplained"]
    assert found.unknown and found.unknown.curves
    (picture,) = [p for p in planned(found) if p.name == "unknown-law"]
    assert len(picture.make().stacks) == len(found.unknown.curves)
    assert "run4, held out: mean square 4.6 times the noise without the law, 1.2 with it" in page(found)
    assert not [p for p in planned(PARTLY) if p.name == "unknown-law"]
