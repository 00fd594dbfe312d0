"""Recordings of real cars, which are not part of the project: bands and verdicts, or an honest refusal."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import rover_sweep as rs
from rover_sweep.report.identification.sentences import handling_notes

MAPS = Path(__file__).parents[1] / "data" / "cars"
DART, CIRCLES, JOYSTICK = (
    "dart_free_driving_2024",
    "umich_ardupilot_rover_circles_2017",
    "umich_nvidia_rover_joystick_2017",
)


@pytest.fixture(scope="module")
def cars(foreign_recordings: Path) -> Callable[[str], Any]:
    """Each car's result, by its name."""

    @cache
    def found(name: str) -> Any:
        runs = rs.read(
            foreign_recordings / "cars" / f"{name}.csv",
            vehicle=MAPS / f"{name}.vehicle.toml",
            columns=MAPS / f"{name}.columns.toml",
        )
        return rs.identify(runs, bootstrap=0)

    return found


def test_the_boat_is_refused(foreign_recordings: Path) -> None:
    name = "blueboat_usv_diffthrust_2024"
    with pytest.raises(rs.DataRefused, match="without steered wheels") as caught:
        rs.read(foreign_recordings / "cars" / f"{name}.csv", columns=MAPS / f"{name}.columns.toml")
    assert caught.value.exit_code == 3 and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "band", "wheelbase"),
    [
        (DART, (0.3, 8.0), 0.1735),
        (CIRCLES, (1.1, 14.0), 0.33),
        pytest.param(JOYSTICK, (1.3, 4.5), 0.3302, marks=pytest.mark.slow),
    ],
)
def test_every_speed_has_a_band_and_every_model_a_verdict_or_a_reason(
    cars: Any, name: str, band: tuple[float, float], wheelbase: float
) -> None:
    """The widest covers `band` [rad/s]; the simple coherence of the sources' notes ends at 13, 15 and 7.
    The steering scales are approximate (20 %), and the cars understeer at the speeds they were driven."""
    result = cars(name)
    found = [g.responses["r"].band for g in result.groups]
    assert all(found)
    low, high = max(found, key=lambda b: b[1] / b[0])
    assert low < band[0] and high > band[1]
    assert set(result.models) | set(result.refused) == {"kinematic", "bicycle", "roll-yaw", "lumped"}
    assert {"roll-yaw", "lumped"} <= set(result.refused)
    assert all(m.verdict.sentences for m in result.models.values())
    assert result.summary[0].startswith(("use the ", "no physical model fits these runs")) and repr(result)
    assert result.models["kinematic"].fit["L_eff"].value == pytest.approx(wheelbase, rel=0.3)


def test_a_car_driven_at_the_friction_limit_gives_no_tyre_parameters(cars: Any) -> None:
    assert cars(DART).recommended == "kinematic"
    assert cars(DART).models["bicycle"].verdict.level == "not identifiable"
    assert cars(DART).handling == {}
    assert sum("friction limit" in n.text for n in handling_notes(cars(DART))) == 3


def test_a_rover_that_hardly_rolls_is_told_so(cars: Any) -> None:
    assert "the roll rate does not follow the steering" in cars(CIRCLES).refused["roll-yaw"]
    assert cars(CIRCLES).models["bicycle"].fit.average < cars(CIRCLES).models["kinematic"].fit.average / 1.5


@pytest.mark.slow
def test_marked_rows_are_left_out(cars: Any) -> None:
    notes = {n.text for g in cars(JOYSTICK).groups for r in g.runs for n in r.notes}
    assert any("rows marked in column bad were left out" in text for text in notes)
