"""The rover's numbers: near the truth of the firmware's plant, with what a vehicle file leaves open."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

import rover_sweep as rs
from rover_sweep.identification.handling import UNITS
from rover_sweep.report.identification.report import identification_report
from rover_sweep.report.identification.sentences import (
    amplitude_sentence,
    handling_sentence,
    modes_sentence,
    residual_sentence,
)
from rover_sweep.report.identification.tables import numbers_table
from rover_sweep.report.in_html import in_html
from rover_sweep.report.on_terminal import on_terminal

DATA = Path(__file__).parents[1] / "data"
NOMINAL = DATA / "ardurover-4.6.3" / "nominal"
TRUE = {"Cf": 31.0, "Cr": 33.5, "Izz": 0.071, "k_phi": 10.8, "b_phi": 0.36, "tau": 0.037}  # its README


@pytest.fixture(scope="module")
def nominal() -> rs.Result:
    runs = [NOMINAL / f"run{k}.BIN" for k in (1, 2, 4)]
    return rs.identify(
        rs.read(*runs, vehicle=DATA / "rover.toml"), models=["bicycle", "roll-yaw"], bootstrap=20
    )


def test_the_numbers_are_the_plants_and_their_intervals_hold_them(nominal: rs.Result) -> None:
    for name, true in TRUE.items():
        low, high = nominal.numbers[name].interval_90
        assert nominal.numbers[name].value == pytest.approx(true, rel=0.08), name
        assert low < true < high and high - low < 0.35 * true, name


def test_understeer_is_that_of_both_axles_together_wherever_it_is_told(nominal: rs.Result) -> None:
    k = nominal.numbers["K_us"]
    assert f"{k.value:.2g} deg/g" in (handling_sentence(nominal) or "")
    sure = replace(nominal.numbers["K_us"], value=2.0, low=1.0, high=3.0)
    (handling,) = (h for n, h in nominal.handling.items() if n == "roll-yaw")
    told = handling.with_understeer(sure, 0.391)
    speed = told["characteristic_speed"]
    assert speed.value == pytest.approx((0.391 * 9.81 / 0.034907) ** 0.5, rel=1e-3)  # sqrt(L g / K)
    assert speed.low < speed.value < speed.high and set(told.quantities) <= set(UNITS)
    assert told.sentence.startswith("the rover understeers: K_us 2 deg/g (1 to 3)")
    gain = told.speed / (0.391 + 0.034907 / 9.81 * told.speed**2)  # V / (L + K V^2)
    assert told["yaw_rate_gain"].value == pytest.approx(gain, rel=1e-3)
    assert told["yaw_rate_gain"].low < gain < told["yaw_rate_gain"].high
    one, other = nominal.handling["roll-yaw"], nominal.handling.get("roll-yaw, Cf and Cr free")
    assert other is None or other["yaw_rate_gain"] == one["yaw_rate_gain"]


def test_the_answer_shows_the_numbers_and_the_fit_beside_them(nominal: rs.Result, tmp_path: Path) -> None:
    assert f"the rover's numbers: Cf {nominal.numbers['Cf'].value:.3g} N/rad" in str(nominal)
    table = numbers_table(nominal)
    assert table is not None and [row[0].text for row in table.rows][:3] == ["Cf", "Cr", "K_us"]
    out = io.StringIO()
    Console(file=out, width=100).print(on_terminal(identification_report(nominal, nominal.origin)))
    assert "Numbers of the rover" in out.getvalue() and "CIFER fit" in out.getvalue()
    nominal.report(tmp_path / "report")
    document = json.loads((tmp_path / "report" / "identification.json").read_text())
    assert document["numbers"]["Cf"]["value"] == nominal.numbers["Cf"].value
    assert len(document["numbers"]["K_us"]["interval_90"]) == 2
    assert "Numbers of the rover" in (tmp_path / "report" / "report.html").read_text()


def test_the_modes_are_those_of_the_handling_wherever_they_are_told(nominal: rs.Result) -> None:
    told = nominal.handling["roll-yaw"].told
    frequency, damping = (f"{told[f'yaw_{n}'].value:.{d}g}" for n, d in (("frequency", 3), ("damping", 2)))
    assert f"yaw {frequency} rad/s with a damping ratio of {damping}" in (modes_sentence(nominal) or "")
    page = in_html(identification_report(nominal, nominal.origin), {})
    assert "Poles at" not in page.partition("Lumped model")[0]


def test_only_noise_is_left_on_the_nominal_rover_and_more_on_another(nominal: rs.Result) -> None:
    assert set(nominal.residual) >= {"r", "ay", "p"} and max(nominal.residual.values()) < 1.3
    assert (residual_sentence(nominal) or "").endswith("noise alone is left.")
    assert "more than noise" in (residual_sentence(replace(nominal, residual={"r": 6.8})) or "")
    assert residual_sentence(replace(nominal, residual={})) is None


def test_the_tyres_bend_more_at_the_larger_amplitude(nominal: rs.Result, tmp_path: Path) -> None:
    small, *_, large = nominal.by_amplitude
    assert (small.amplitude, large.amplitude, small.unit) == (pytest.approx(120), pytest.approx(240), "us")
    assert large.stiffness["Cf"] < small.stiffness["Cf"] < TRUE["Cf"]
    bent = replace(large, stiffness={"Cf": 0.9 * small.stiffness["Cf"], "Cr": small.stiffness["Cr"]})
    told = amplitude_sentence(replace(nominal, by_amplitude=(small, bent))) or ""
    assert "falls from" in told and "between 120 us and 240 us: the tyres bend" in told
    swapped = replace(small, stiffness=bent.stiffness), replace(bent, stiffness=small.stiffness)
    assert "which tyres do not" in (amplitude_sentence(replace(nominal, by_amplitude=swapped)) or "")
    assert amplitude_sentence(replace(nominal, by_amplitude=(small, small))) is None
    out = io.StringIO()
    Console(file=out, width=100).print(on_terminal(identification_report(nominal, nominal.origin)))
    assert "Cornering stiffness at each amplitude" in out.getvalue()


def test_where_the_numbers_are_not_known_there_are_none() -> None:
    """Without intervals, of tyres that these runs do not show, and of a rover with other physics."""
    runs = rs.read(NOMINAL / "run1.BIN", vehicle=DATA / "rover.toml")
    plain = rs.identify(runs, models=["roll-yaw"], bootstrap=0)
    assert not plain.numbers and plain.by_amplitude == ()  # one amplitude shows no bend
    stock = rs.read(DATA / "ardurover-4.6.3" / "stock" / "run1.BIN", vehicle=DATA / "rover.toml")
    assert not rs.identify(stock, models=["roll-yaw"]).numbers
    folder = DATA / "concealed-ardurover" / "d"
    runs = rs.read(folder / "run1.BIN", folder / "run2.BIN", vehicle=folder / "rover.toml")
    found = rs.identify(runs, models=["roll-yaw"])
    assert not found.numbers and any("times the noise in r" in sentence for sentence in found.summary)
