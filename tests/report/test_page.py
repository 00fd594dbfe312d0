"""report.html: one page, nothing fetched, all pictures in it."""

from __future__ import annotations

from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from rover_sweep.data.results import number
from rover_sweep.report.identification.report import identification_report
from rover_sweep.report.in_html import in_html


class Elements(HTMLParser):
    """Tags with attributes, visible text, and whether every tag was closed."""

    VOID = ("meta", "img", "br", "link", "input", "hr")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self.open and "script" not in self.open:
            self.text += data


@pytest.fixture(scope="module")
def html(reports: dict[str, Path]) -> str:
    return (reports["nominal"] / "report.html").read_text(encoding="utf-8")


def test_page_is_well_formed_and_fetches_nothing(html: str) -> None:
    elements = Elements(html)
    assert elements.open == []
    assert not [tag for tag, _ in elements.tags if tag in ("link", "iframe")]
    assert not [a for tag, a in elements.tags if tag == "script" and "src" in a]
    policy = next(a["content"] for _, a in elements.tags if a.get("http-equiv"))
    assert policy and policy.startswith("default-src 'none'") and "http" not in policy
    links = [v for _, a in elements.tags for k, v in a.items() if k in ("src", "href") and v]
    assert all(v.startswith("#") for v in links)
    assert "url(" not in html and "@import" not in html


def test_links_within_the_page_lead_somewhere(html: str) -> None:
    tags = Elements(html).tags
    places = {a.get("id") for _, a in tags}
    assert {(a["href"] or "")[1:] for tag, a in tags if tag == "a"} <= places


def test_pictures_are_those_of_the_folder_and_have_a_text(html: str, reports: dict[str, Path]) -> None:
    for path in (reports["nominal"] / "pictures").glob("*.svg"):
        assert path.read_text(encoding="utf-8") in html
    assert all(a["aria-label"] for _, a in Elements(html).tags if a.get("role") == "img")


def test_contents_are_in_the_order_of_the_page(html: str) -> None:
    tags = Elements(html).tags
    listed = [(a["href"] or "")[1:] for tag, a in tags if tag == "a"]
    places = [a["id"] for _, a in tags if a.get("id") in listed]
    assert places == listed and listed[:2] == ["answer", "pictures"]


def test_the_answer_comes_first_and_the_numbers_follow(html: str, nominal: Any) -> None:
    text = Elements(html).text
    fit = nominal.result.models["roll-yaw"].fit
    assert text.index("Use the roll-yaw model") < text.rindex("Comparison of the models")
    assert number(fit["Cf"].value) in text and number(fit["k_phi"].value) in text
    digest = nominal.result.groups[0].runs[0].sources[0][1]
    for words in (
        "0.06900",
        "structure reduction",
        "INS_GYRO_FILTER",
        "ignores the sensors'",
        "numpy",
        digest,
    ):
        assert words in text


def test_light_dark_and_print_are_provided_for(html: str) -> None:
    assert "prefers-color-scheme: dark" in html and "@media print" in html


def test_rejected_numbers_are_nowhere_on_the_page(reports: dict[str, Path], stock: Any) -> None:
    text = Elements((reports["stock"] / "report.html").read_text(encoding="utf-8")).text
    rejected = stock.result.models["bicycle"].fit
    assert "not identifiable" in text and "Use the kinematic model" in text
    assert number(rejected["C"].value) not in text
    assert number(stock.result.models["kinematic"].fit["L_eff"].value) in text


def test_names_from_files_cannot_become_markup(nominal: Any) -> None:
    vehicle = replace(nominal.provenance.vehicle, name="<script>alert(1)</script>")
    text = in_html(identification_report(nominal.result, replace(nominal.provenance, vehicle=vehicle)))
    assert "<script>" not in text and "&lt;script&gt;" in text
