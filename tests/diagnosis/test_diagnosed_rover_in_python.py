"""`export --python` of a diagnosis: the numbers in the file are those of its variant.toml."""

from __future__ import annotations

from pathlib import Path

import pytest
from augmented_models import model

from rover_sweep.cli.main import run
from rover_sweep.diagnosis.result import Diagnosis
from rover_sweep.report.diagnosis.diagnosis_json import DiagnosisOrigin
from rover_sweep.report.diagnosis.report import write_diagnosis

DIAGNOSED = ("steering_backlash", "tyre_relaxation")


def written(folder: Path, baseline: str = "roll-yaw") -> Path:
    found = Diagnosis("none", "nothing is left out", baseline, model=model(*DIAGNOSED, baseline=baseline))
    return write_diagnosis(found, folder, DiagnosisOrigin()).document


def test_a_diagnosis_and_its_variant_give_the_same_rover(tmp_path: Path) -> None:
    document = written(tmp_path)
    for place, out in ((document, "one.py"), (tmp_path, "two.py")):
        assert run(["export", str(place), "--python", str(tmp_path / out)]) == 0
    one, two = ((tmp_path / name).read_text() for name in ("one.py", "two.py"))
    assert one.partition("from __future__")[2] == two.partition("from __future__")[2]
    assert "the numbers of diagnosis.json." in one and "the numbers of variant.toml." in two
    for effect in DIAGNOSED:
        assert f"'{effect}': {{" in one


def test_a_diagnosis_without_a_simulated_rover_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = written(tmp_path)
    text = document.read_text()
    assert '"baseline": "roll-yaw"' in text
    document.write_text(text.replace('"baseline": "roll-yaw"', '"baseline": "lumped"'))
    (tmp_path / "variant.toml").unlink()
    assert run(["export", str(tmp_path), "--python", str(tmp_path / "x.py")]) in (2, 3)
    told = capsys.readouterr().err
    assert len(told.splitlines()) == 1 and not (tmp_path / "x.py").exists()
