"""A law without a name in the variant file: the simulated rover drives as the model with the law says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from augmented_models import model
from test_augmented_variant import driven, plain, rms, simulated

from rover_sweep.diagnosis.simulation.table_law import TableLaw, resonator
from rover_sweep.report.export.augmented_model_json import augmented_document, augmented_from
from rover_sweep.report.export.plant_variant import variant_text
from sitl.plant.plant_law import table_laws
from sitl.plant.variant import load_variant
from sitl.plant.variant_text import variant_text as plant_text

LAWS = {
    "steering": TableLaw("steering", "delta", (-0.3, -0.1, 0.1, 0.3), (0.04, 0.0, 0.0, -0.04)),
    "steering with play": TableLaw("steering", "delta", (-0.3, 0.3), (0.1, -0.1), memory="play", size=0.03),
    "yaw moment": TableLaw("yaw moment", "r", (-2.0, 0.0, 2.0), (1.4, 0.0, -1.4)),
    "side force front": TableLaw("side force front", "a_y", (-4.0, 4.0), (2.0, -2.0)),
    "side force rear": TableLaw("side force rear", "v", (1.0, 3.0), (0.2, 0.6), "a_y"),
    "swinging load": replace(resonator("side force", "a_y", 1.4, 0.2), y=(0.25, 0.05)),
    "soft linkage": replace(resonator("steering", "delta", 4.0, 0.3), y=(0.1, 0.0)),
}


@pytest.mark.parametrize("name", LAWS)
def test_a_law_does_in_the_plant_what_it_does_in_the_model(name: str, tmp_path: Path) -> None:
    whole = replace(model(), laws=(LAWS[name],))
    model_without, plant_without = plain()
    wanted = simulated(whole)["r"] - model_without["r"]
    done = driven(whole, tmp_path)["r"] - plant_without["r"]
    assert rms(wanted) > 0.01 * rms(model_without["r"])  # there is something to reproduce
    assert rms(done - wanted) < 0.12 * rms(wanted)


def test_a_law_that_the_plant_lacks_is_a_sentence(tmp_path: Path) -> None:
    text = variant_text(replace(model(), laws=(TableLaw("sensor of r", "signal", (0.0, 1.0), (0.0, 0.1)),)))
    assert "# The law at the sensor of r over signal is not included" in text
    path = tmp_path / "a.toml"
    path.write_text(text)
    assert load_variant(path).laws == ()


def test_a_variant_with_laws_is_written_and_read_again(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text(variant_text(replace(model(), laws=tuple(LAWS.values()))))
    first = load_variant(path)
    assert [law.place for law in first.laws] == [law.place for law in LAWS.values()]
    path.write_text(plant_text(first))
    assert load_variant(path) == first


def test_a_model_with_laws_survives_its_document() -> None:
    whole = replace(model(), laws=tuple(LAWS.values()))
    again = augmented_from(augmented_document(whole))
    assert again.laws == whole.laws and "laws at the yaw moment" in again.name
    still = {**vars(LAWS["swinging load"]), "damping": 0.0}
    with pytest.raises(ValueError, match="damping above 0"):
        augmented_from({**augmented_document(whole), "laws": [still]})
    with pytest.raises(ValueError, match="no place"):
        augmented_from({**augmented_document(whole), "laws": [{**vars(LAWS["steering"]), "place": "moon"}]})


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"place": "moon"}, "place"),
        ({"x": [1.0, 0.0]}, "ascend"),
        ({"x": [0.0]}, "list of 2"),
        ({"y": [0.0, float("nan")]}, "finite"),
        ({"play": -1.0}, "play"),
        ({"frequency": 1.4}, "damping above 0"),
        ({"frequency": 30.0, "damping": 0.1}, "up to 20 Hz"),
        ({"damping": 0.1}, "resonator"),
        ({"frequency": 1.4, "damping": 0.1, "play": 0.1}, "no factor or play"),
        ({"colour": 1}, "has no colour"),
    ],
)
def test_a_wrong_table_is_refused_with_its_name(change: dict[str, object], why: str) -> None:
    good = {"place": "steering", "over": "delta", "x": [0.0, 1.0], "y": [0.0, 0.1]}
    assert table_laws([good], "a.toml")[0].y == (0.0, 0.1)
    with pytest.raises(ValueError, match=why):
        table_laws([{**good, **change}], "a.toml")
