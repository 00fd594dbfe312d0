"""The command line: start-up, errors, exit codes, and what each of these commands shows."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any
from unittest import mock

import click
import pytest

from rover_sweep import __version__, errors
from rover_sweep.cli import main
from rover_sweep.cli.driving import shown_results
from rover_sweep.cli.options import Grouped
from rover_sweep.data.vehicle_file import example, load
from rover_sweep.diagnosis.result import Diagnosis

NOMINAL = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "nominal"
ROVER = str(Path(__file__).parents[1] / "data" / "rover.toml")
SWING = [
    "inertia",
    "--mass",
    "2.66+-0.005",
    "--length",
    "1.2+-0.003",
    "--spacing",
    "0.3+-0.001",
    "--swings",
    "20",
    "--times",
    "47.5,47.3,47.6",
]


def test_help_imports_nothing_heavy() -> None:
    script = (
        "import sys; from rover_sweep.cli.main import run; run(['--help']);"
        "heavy = {'numpy', 'scipy', 'matplotlib', 'rich', 'pymavlink', 'tomlkit', 'textual', 'mavsdk'};"
        "heavy &= set(sys.modules);"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert all(name in done.stdout for name in main.COMMANDS)
    assert all(f"\n{section}:\n" in done.stdout for section in main.SECTIONS)


@pytest.mark.parametrize("name", ["run", "identify", "diagnose"])
def test_options_are_in_groups_with_the_rare_ones_last(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    command = main.cli.get_command(click.Context(main.cli), name)
    assert isinstance(command, Grouped)
    parameters = {p.name for p in command.params if isinstance(p, click.Option)}
    assert set(" ".join(command.groups.values()).split()) <= parameters
    assert main.run([name, "--help"]) == 0
    shown = capsys.readouterr().out
    headings = [*command.groups, "Rarely needed"]
    assert [line[:-1] for line in shown.splitlines() if line[:-1] in headings] == headings
    assert all(p.opts[0] in shown for p in command.params if isinstance(p, click.Option))


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(["--version"]) == 0
    assert capsys.readouterr().out == f"rover-sweep {__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["inertai"], "did you mean inertia?"),
        (["--fast"], "No such option"),
        (["vehicle", "check"], "Missing argument 'FILE'"),
        (["vehicle", ROVER], "use: rover-sweep vehicle check"),
        (["design", "--wmin", "30"], "must lie below --wmax"),
        (["design", "--type", "doublet", "--wmin", "1"], "--wmin belongs to --type sweep"),
        (["design", "--type", "multisine", "--bias", "50"], "--bias belongs to --type bias-sweep"),
        (["design", "--type", "multisine", "--trec", "5"], "contain 3 odd lines"),
        (["design", "--type", "bias-sweep", "--bias", "450"], "SWP_BIAS 450 us is outside -400 to 400"),
        (["design", "--plot", "x.foo"], "cannot be written"),
        (["design", "--wmin", "nan"], "'--wmin': 'nan' is not a finite number"),
        (["design", "--speed", "inf"], "'--speed': 'inf' is not a finite number"),
        (["design", "--speed", "fast"], "'--speed': 'fast' is not a valid number"),
        (["bench", "--steps", "50,inf"], "every number must be positive and finite"),
        (["design", "--amplitude", "600"], "SWP_AMP 600 us is outside 1 to 500"),
        (["design", "--speed", "50", "--vehicle", ROVER], "94 g of lateral acceleration"),
        (["inertia", "--length", "120", "--spacing", "0.3", "--times", "2.4"], "give metres"),
        (
            ["inertia", "--length", "1.2", "--spacing", "0.3+-0.4", "--times", "2.4"],
            "the uncertainty must be",
        ),
        (["inertia", "--length", "1.2", "--spacing", "0.3", "--times", "2.4;2.5"], "not a list of times"),
        (
            ["inertia", "--length", "1.2", "--spacing", "0.3", "--times", "2.4"],
            "--mass is missing; give it, or a --vehicle file",
        ),
        (
            ["inertia", "--axis", "roll", "--length", "1.2", "--spacing", "0.3", "--times", "2"],
            "give the mass on the wires",
        ),
        ([*SWING, "--rig-mass", "1"], "--rig-mass and --rig-times go together"),
        ([*SWING, "--rig-mass", "5", "--rig-times", "60"], "check --times and --rig-times"),
    ],
)
def test_a_usage_error_is_one_line_and_2(arguments, said, capsys):
    assert main.run(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("rover-sweep: ") and said in err and err.count("\n") == 1


@pytest.mark.parametrize("command", ["identify", "diagnose", "twin"])
def test_a_missing_recording_is_named_before_the_vehicle_file(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main.run([command, "run1.BIN+run1.tlog", "--out", "report"]) == 2
    assert "run1.BIN: there is no such file" in capsys.readouterr().err


def with_note(error: BaseException, note: str) -> BaseException:
    error.add_note(note)
    return error


@pytest.mark.parametrize(
    ("raised", "code", "said"),
    [
        (errors.UsageError("wrong"), 2, "rover-sweep: wrong\n"),
        (errors.DataRefused("empty"), 3, "rover-sweep: empty\n"),
        (with_note(errors.LinkError("silent"), "armed?"), 4, "rover-sweep: silent\narmed?\n"),
        (KeyboardInterrupt(), 130, "rover-sweep: interrupted\n"),
        (click.Abort(), 130, "rover-sweep: interrupted\n"),
    ],
)
def test_errors_become_exit_codes_and_their_notes_the_last_lines(raised, code, said, monkeypatch, capsys):
    monkeypatch.setattr(main.cli, "invoke", mock.Mock(side_effect=raised))
    assert main.run(["design"]) == code
    assert capsys.readouterr().err.lstrip("\n") == said


@pytest.mark.parametrize(
    ("shell", "shown"),
    [("{} | head -c 1; exit ${{PIPESTATUS[0]}}", "#"), ("{} >&-", "")],
    ids=["pipe", "none"],
)
def test_output_to_a_closed_pipe_or_to_nobody_is_no_error(shell: str, shown: str) -> None:
    command = shell.format(f"{sys.executable} -m rover_sweep vehicle --example")
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, shown) and done.stderr.startswith("next: ")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_output_that_cannot_be_written_is_a_sentence() -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "rover_sweep", "--help"], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert done.returncode == 1
    assert done.stderr.startswith("rover-sweep: the output cannot be written: No space left on device; ")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("command", "file"), [("identify", "pictures/mine.svg"), ("diagnose", "diagnosis.html")]
)
def test_a_folder_of_other_files_is_not_replaced(command, file, tmp_path, capsys):
    held = tmp_path / "out" / file
    held.parent.mkdir(parents=True)
    held.write_text("mine")
    assert main.run([command, "run.BIN", "--out", str(tmp_path / "out")]) == 2
    assert f"has {file} but no " in capsys.readouterr().err
    assert held.read_text() == "mine"


def test_an_input_is_not_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "run.BIN"
    log.write_text("a recording")
    (tmp_path / "run.html").write_text("mine")
    for command in (
        ["view", str(log), "--out", str(log)],
        ["export", str(tmp_path), "-o", str(tmp_path / "identification.json")],
        ["gains", str(tmp_path), "--now", str(log), "--out", str(log)],
    ):
        assert main.run(command) == 2
        assert "is an input of this command" in capsys.readouterr().err
    assert log.read_text() == "a recording"


def test_ctrl_c_while_the_report_is_written_loses_no_diagnosis(tmp_path, monkeypatch, capsys):
    def interrupted(*given: Any) -> Any:
        os.kill(os.getpid(), signal.SIGINT)
        return write(*given)

    write = shown_results.write_diagnosis
    monkeypatch.setattr(shown_results, "write_diagnosis", interrupted)
    found = Diagnosis("none", "no effect is missing", "roll-yaw")
    monkeypatch.setattr(shown_results, "diagnosed", lambda *ignored: found)
    out = tmp_path / "found"
    runs = [str(NOMINAL / f"run{k}.BIN") for k in (1, 4)]
    assert main.run(["diagnose", *runs, "--vehicle", ROVER, "--out", str(out)]) == 130
    assert (out / "diagnosis.html").is_file() and (out / "diagnosis.json").is_file()
    assert "press Ctrl-C again" in capsys.readouterr().err


def test_plain_ascii_terminal() -> None:
    command = [sys.executable, "-m", "rover_sweep", "vehicle", "check", ROVER]
    environment = {"PYTHONIOENCODING": "ascii", "PATH": ""}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0 and "2.66 +- 0.005" in done.stdout


def test_letters_that_a_terminal_lacks_are_spelt_out() -> None:
    from rover_sweep.cli.views.output import NAME

    assert "k_φ 3 … 4 kg m², 車".encode("ascii", NAME) == b"k_phi 3 .. 4 kg m^2, ?"
    assert "τ ±".encode("latin-1", NAME) == b"tau \xb1"


def test_vehicle_example_and_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(["vehicle", "--example"]) == 0
    assert capsys.readouterr().out == example()
    assert main.run(["vehicle", "check", ROVER]) == 0
    shown = capsys.readouterr().out
    assert "roll-yaw: sufficient" in shown and "2.66 ± 0.005" in shown
    assert main.run(["vehicle", "check", ROVER, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["mass"] == {"value": 2.66, "sd": 0.005, "how": ""} and data["models"]["roll-yaw"] is True
    path = tmp_path / "rover.toml"
    path.write_text("[vehicle]\nmass = 2.66\ncg_to_front_axle = 0.2\ncg_to_rear_axle = 0.2\n")
    assert main.run(["vehicle", "check", str(path)]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "bicycle: sufficient" in shown and "roll-yaw: also needs sprung_mass" in shown
    assert "lumped: also needs sprung_mass" in shown
    assert "no [steering]" in shown and "no [imu] position" in shown
    path.write_text(example().replace("mass = { value = 2.66,", "mass = { value = 26.6,"))
    assert main.run(["vehicle", "check", str(path)]) == 2
    out, err = capsys.readouterr()
    assert "sufficient" not in out
    assert "the vehicle file is implausible: sprung mass / mass is 0.09 (plausible: 0.4 to 1)" in err


def test_inertia_writes_the_file_and_shows_the_uncertainty(tmp_path, capsys):
    path = tmp_path / "rover.toml"
    path.write_text(example())
    assert main.run([*SWING, "--check-times", "43.9,44.1", "--write", str(path)]) == 0
    out, err = capsys.readouterr()
    assert "0.06981 ± 0.00063 kg m^2" in out and "passed" in out
    assert "written into" in err
    with_mass = load(path).yaw_inertia
    assert with_mass is not None and (with_mass.value, with_mass.sd) == (0.06981, 0.00063)
    assert main.run([SWING[0], *SWING[3:], "--write", str(path)]) == 0  # with the mass of the file
    found = load(path).yaw_inertia
    assert found is not None
    assert found.value / with_mass.value == pytest.approx(load(path).mass.value / 2.66, rel=2e-3)


def test_a_swing_test_that_is_not_good_is_not_written(tmp_path, capsys):
    path = tmp_path / "rover.toml"
    path.write_text(before := example())
    bad = [*SWING, "--check-times", "40", "--write", str(path)]
    assert main.run([*bad, "--json"]) == 3
    out, err = capsys.readouterr()
    data = json.loads(out)
    assert data["moment_kg_m2"]["value"] == pytest.approx(0.0698, rel=1e-3)
    assert data["gravity_check"]["passed"] is False
    assert any("off 9.81" in text for text in data["remarks"])
    assert "not written into" in err and "off" in err and err.count("\n") == 1
    wrong_count = [*SWING[:-3], "1", *SWING[-2:], "--write", str(path)]  # 47 s for one swing
    assert main.run(wrong_count) == 3
    assert "radius of gyration" in capsys.readouterr().err
    assert path.read_text() == before
    assert main.run([*bad, "--force"]) == 0
    assert load(path).yaw_inertia is not None and path.read_text() != before


def test_inertia_of_the_roll_axis_says_about_which_axis(capsys: pytest.CaptureFixture[str]) -> None:
    swing = ["--mass", "2.66", "--length", "1.2", "--spacing", "0.1", "--times", "3.0"]
    assert main.run(["inertia", "--axis", "roll", *swing, "--vehicle", ROVER]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "sprung mass about the forward axis through its own CG" in shown
    assert "sprung_mass = 2.4 kg" in shown and "upper bound" in shown


def test_design_shows_numbers_pictures_and_warnings(tmp_path, capsys):
    picture = tmp_path / "design.png"
    asked = ["design", "--wmin", ".3", "--wmax", "25", "--trec", "55", "--amplitude", "150", "--speed", "2.5"]
    assert main.run([*asked, "--vehicle", ROVER, "--plot", str(picture)]) == 0
    out, err = capsys.readouterr()
    for part in (
        "3758 us/s",
        "205 deg/s",
        "127 x 39 m",
        "5.3 of 0.3 rad/s in the T_rec of all runs",
        "INS_GYRO_FILTER 4 Hz has a lag",
        "\u28ff",
    ):
        assert part in out
    assert all(len(line) <= 80 for line in out.splitlines())
    assert picture.read_bytes().startswith(b"\x89PNG") and "picture written" in err
    assert main.run(["design", "--json", "--type", "doublet", "--speed", "2", "--vehicle", ROVER]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["manoeuvre"]["kind"] == "doublet" and data["duration"] == 14.0
    assert data["space"]["ay"] == pytest.approx(2**2 * 0.1435 / 0.391, rel=0.01)


def test_design_names_what_it_assumes_and_what_is_missing(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(["design", "--gyro-filter", "20"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "defaults for SCHED_LOOP_RATE, INS_ACCEL_FILTER; give" in shown
    assert "give --vehicle rover.toml and --speed" in shown
    assert main.run(["design", "--gyro-filter", "20", "--accel-filter", "20", "--loop-rate", "100"]) == 0
    assert "assumed" not in capsys.readouterr().out


def test_a_session_without_a_terminal_is_refused(run_program, tmp_path):
    done = run_program("session", "--connect", "udp:127.0.0.1:14998", "--out", str(tmp_path / "today"))
    assert done.code == 2
    assert "needs a terminal; without one use `rover-sweep run`" in " ".join(done.err.split())
