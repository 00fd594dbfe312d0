"""The command line on recordings of the real firmware, held to their truth (see the recordings' README)."""

import json
import shutil
from pathlib import Path

import pytest

from rover_sweep.cli.main import run

TRUE_C, TRUE_IZZ, TRUE_K_PHI = (31.0 + 33.5) / 2, 0.071, 10.8
NEW = "ardurover-4.6.3"
FEWER = ("--bootstrap", "0")  # no interval is looked at


def identified(data: Path, out: Path, runs: list[str], verify: list[str], *options: str) -> dict:
    sources = ["+".join(str(data / part) for part in r.split("+")) for r in runs]
    checks = [a for v in verify for a in ("--verify", "+".join(str(data / part) for part in v.split("+")))]
    vehicle = ["--vehicle", str(data / "rover.toml")]
    assert run(["identify", *sources, *checks, *vehicle, "--out", str(out), *options]) == 0
    return json.loads((out / "identification.json").read_text())


@pytest.fixture(scope="module")
def nominal(data, tmp_path_factory) -> tuple[dict, Path]:
    out = tmp_path_factory.mktemp("nominal")
    runs = [f"{NEW}/nominal/run1.BIN", f"{NEW}/nominal/run2.BIN"]
    return identified(data, out, runs, [f"{NEW}/nominal/run4.BIN"], *FEWER), out


def _mean_stiffness(parameters):
    """Of both axles, which are alike, whether they were fitted apart or not."""
    tied = parameters.get("C")
    return tied["value"] if tied else (parameters["Cf"]["value"] + parameters["Cr"]["value"]) / 2


def test_nominal_parameters_are_the_true_ones(nominal):
    parameters = nominal[0]["models"]["roll-yaw"]["parameters"]
    assert _mean_stiffness(parameters) == pytest.approx(TRUE_C, rel=0.08)
    assert parameters["Izz"]["value"] == pytest.approx(TRUE_IZZ, rel=0.06)
    assert parameters["k_phi"]["value"] == pytest.approx(TRUE_K_PHI, rel=0.08)
    for name in ("Cf", "Cr", "Izz", "k_phi", "b_phi", "tau"):
        assert parameters[name]["free"] is True
        assert 0 < parameters[name]["insensitivity_percent"] <= parameters[name]["cr_percent"] / 2 + 1e-9


def test_nominal_cost_and_verification(nominal):
    model = nominal[0]["models"]["roll-yaw"]
    assert model["cost"]["average"] <= 8
    assert model["cost"]["average"] == pytest.approx(sum(model["cost"][c] for c in ("r", "ay", "p")) / 3)
    assert model["cost"]["average_all"] > model["cost"]["average"]
    assert model["verification"]["tic"] <= 0.07
    assert model["verification"]["j_rms"] <= 2.0
    assert nominal[0]["recommended"] == "roll-yaw"
    assert nominal[0]["speed_m_s"] == pytest.approx(2.45, abs=0.05)


def test_nominal_report_is_whole(nominal):
    document, out = nominal
    assert set(document["models"]) >= {"bicycle", "roll-yaw", "lumped"}
    assert [sorted(r["coherence"]) for r in document["runs"]] == [["ay", "p", "r", "vydot"]] * 2
    page = (out / "report.html").read_text()
    assert page.count("<svg") >= 4
    named = page.replace("http://www.w3.org", "").replace("https://github.com/leeoniya/uPlot", "")
    assert "http://" not in named and "https://" not in named
    assert sorted(p.name for p in (out / "pictures").glob("*.svg"))


@pytest.mark.parametrize("kind", ["tlog", "pair"])
def test_factory_filters_are_taken_into_account(data, tmp_path, kind: str):
    def source(n: int) -> str:
        name = f"{NEW}/defaults/run{n}"
        return f"{name}.BIN+{name}.tlog" if kind == "pair" else f"{name}.{kind}"

    document = identified(data, tmp_path, [source(1)], [source(2)], "--models", "roll-yaw", *FEWER)
    model = document["models"]["roll-yaw"]
    assert model["parameters"]["Izz"]["value"] == pytest.approx(TRUE_IZZ, rel=0.12)
    ignored = model["variants"]["filters ignored"]
    assert ignored["parameters"]["Izz"]["value"] > 1.3 * TRUE_IZZ
    assert ignored["parameters"]["tau"]["value"] > model["parameters"]["tau"]["value"] + 0.03
    assert ignored["cost"]["average"] < 50  # it looks perfectly fine, which is the point
    assert "filter" in (tmp_path / "report.html").read_text()


def test_other_firmware_and_speed(data, tmp_path):
    sources = ["ardurover-4.5.7/nominal/run1.BIN", f"{NEW}/nominal/run3.BIN"]
    checks = ["ardurover-4.5.7/nominal/run2.BIN"]
    document = identified(data, tmp_path, sources, checks, "--models", "roll-yaw", *FEWER)
    parameters = document["models"]["roll-yaw"]["parameters"]
    assert _mean_stiffness(parameters) == pytest.approx(TRUE_C, rel=0.08)
    assert parameters["Izz"]["value"] == pytest.approx(TRUE_IZZ, rel=0.06)
    assert document["models"]["roll-yaw"]["verification"]["tic"] <= 0.07


def test_a_kinematic_rover_has_no_tyres(data, tmp_path):
    document = identified(data, tmp_path, [f"{NEW}/stock/run1.BIN"], [f"{NEW}/stock/run2.BIN"])
    assert document["recommended"] == "kinematic"
    bicycle = document["models"]["bicycle"]
    assert bicycle["verdict"]["level"] == "not identifiable"
    assert bicycle["parameters"]["C"]["value"] is None
    assert "roll rate does not follow" in document["refused"]["roll-yaw"]
    assert "kinematic" in document["summary"][0]
    tau = document["models"]["kinematic"]["parameters"]["tau"]
    assert tau["value"] == 0.0 and not tau["at_bound"], "no delay is a result, not a bound"
    assert "inf %" not in json.dumps(document)


def test_the_doublet_in_the_same_call_verifies_and_json_is_the_file(data, tmp_path, capsys):
    runs = [f"{NEW}/nominal/run1.BIN", f"{NEW}/nominal/run4.BIN"]
    document = identified(data, tmp_path, runs, [], "--models", "bicycle", "--json", *FEWER)
    assert [r["name"] for r in document["runs"]] == ["run1"]
    assert [r["name"] for r in document["verification_recordings"]] == ["run4"]
    assert document["models"]["bicycle"]["verification"]["tic"] <= 0.07
    assert json.loads(capsys.readouterr().out) == document


def test_a_run_may_not_judge_itself(data, tmp_path, capsys):
    source = str(data / NEW / "nominal/run1.BIN")
    vehicle = ["--vehicle", str(data / "rover.toml")]
    assert run(["identify", source, "--verify", source, *vehicle, "--out", str(tmp_path)]) == 2
    assert "used both to identify and to verify" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "options"), [("identify", ["--vehicle", "rover.toml", "--out", "out"]), ("coherence", [])]
)
def test_useless_recordings_get_one_sentence(
    foreign_recordings, data, tmp_path, monkeypatch, capsys, command, options
):
    shutil.copy(data / "rover.toml", tmp_path)
    monkeypatch.chdir(tmp_path)
    sources = sorted((foreign_recordings / "rover_logs").iterdir())
    assert sources
    for source in sources:
        assert run([command, str(source), *options]) == 3, source
        said = capsys.readouterr().err.strip()
        assert said.startswith("rover-sweep: ") and "\n" not in said, said
        assert not (tmp_path / "out" / "identification.json").exists()


@pytest.mark.parametrize(("content", "word"), [(b"", "empty"), (b"no log at all " * 99, "log")])
@pytest.mark.parametrize("suffix", ["BIN", "tlog"])
def test_files_that_are_no_logs(tmp_path, capsys, content: bytes, word: str, suffix: str):
    path = tmp_path / f"wrong.{suffix}"
    path.write_bytes(content)
    assert run(["coherence", str(path)]) == 3
    assert word in capsys.readouterr().err


def test_coherence_says_keep(data, capsys):
    assert run(["coherence", str(data / NEW / "nominal/run2.BIN"), "--json"]) == 0
    verdict = json.loads(capsys.readouterr().out)[0]
    assert verdict["keep"] is True
    assert verdict["sentence"].startswith("keep")
