"""`identify --structure` and `--condition-on`: a whole run of both, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from rover_sweep.cli.main import run
from rover_sweep.identification.toml_form import structure_from_text
from rover_sweep.report.export.exported_model import at_speed

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data"
RUN = str(DATA / "ardurover-4.6.3" / "nominal" / "run1.BIN")
BICYCLE = DATA / "structures" / "bicycle.toml"


def identify(out: Path, *more: str) -> int:
    common = ["--vehicle", str(DATA / "rover.toml"), "--models", "bicycle", "--bootstrap", "0"]
    return run(["identify", RUN, *common, "--out", str(out), *more])


def test_a_structure_stands_beside_the_models(tmp_path: Path) -> None:
    assert identify(tmp_path, "--structure", str(BICYCLE), "--condition-on", "throttle") == 0
    document = json.loads((tmp_path / "identification.json").read_text())
    own = document["models"]["bicycle-of-a-file"]
    assert own["parameters"]["C"]["free"] and own["parameters"]["C"]["cr_percent"] > 0
    assert (
        "throttle is constant in these runs, so the responses are not conditioned on it"
        in document["summary"]
    )
    assert "bicycle-of-a-file" in (tmp_path / "report.html").read_text()
    exported = json.loads((tmp_path / "models" / "bicycle-of-a-file.json").read_text())
    moved = at_speed(exported, 4.0)
    structure = structure_from_text(BICYCLE.read_text()).with_values(exported["parameters"])
    np.testing.assert_allclose(moved["F"], structure.matrices(4.0).f)
    np.testing.assert_allclose(np.linalg.eigvals(moved["A"]), structure.poles(4.0))


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--structure", "mine.toml"], "G row 2 column 1: 'a*Cx/Izz' uses 'Cx', which is no parameter"),
        (["--structure", "named.toml"], "a model named 'bicycle' exists"),
        (["--structure", "absent.toml"], "absent.toml cannot be read"),
        (["--condition-on", "wind"], "run1 has no 'wind' to condition on; it holds speed, throttle"),
        (["--condition-on", "r"], "r is the steering or follows it"),
    ],
)
def test_mistakes_end_with_a_sentence(more, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = BICYCLE.read_text()
    Path("mine.toml").write_text(text.replace("a*C/Izz", "a*Cx/Izz"))
    Path("named.toml").write_text(text.replace('"bicycle-of-a-file"', '"bicycle"'))
    assert identify(tmp_path / "out", *more) == 2
    assert words in capsys.readouterr().err


def test_the_structure_in_the_readme_is_one() -> None:
    blocks = (part.split("```")[0] for part in (ROOT / "docs/formats.md").read_text().split("```toml\n")[1:])
    text = next(block for block in blocks if "[parameters]" in block)
    assert structure_from_text(text).values["Cr"] == pytest.approx(0.9 * 39)
