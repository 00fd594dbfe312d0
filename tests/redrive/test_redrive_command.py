"""What `redrive` refuses, and whose numbers it says that it takes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from rover_sweep.cli.main import run
from rover_sweep.logs.read import read_runs
from rover_sweep.redrive.recorded_course import on_the_clock, simulated_rover
from sitl.plant.variant import load_variant
from sitl.plant.variant_text import variant_text

RUN = "ardurover-4.6.3/applet/run2.BIN"


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("{log}", "--out", "{tmp}/again.csv"), 2, "give a name that ends in .BIN"),
        (("{log}", "--out", "{tmp}/none/again.BIN"), 2, "there is no folder"),
        (("{log}", "--out", "{tmp}/old.BIN"), 2, "already exists; give another name"),
        (("{tmp}/none.BIN", "--out", "{tmp}/again.BIN"), 2, "there is no such file"),
        (("{log}", "--out", "{tmp}/again.BIN", "--variant", "icy"), 2, "no variant icy: give one of"),
        (("{log}", "--out", "{tmp}/again.BIN", "--variant", "{tmp}/bad.toml"), 2, "there is no effect slack"),
        (("{log}", "--out", "{tmp}/again.BIN", "--vehicle", "no.toml"), 2, "there is no vehicle file"),
        (
            ("{log}", "--out", "{tmp}/again.BIN", "--variant", "{tmp}/ice.toml", "--simulator", "embedded"),
            2,
            "surface_change at a time cannot be placed on the clock of --simulator embedded",
        ),
        (
            ("{log}", "--out", "{tmp}/again.BIN", "--variant", "{tmp}/rub.toml"),
            2,
            "suspension_friction: T = 100 N m must be at most 3.3 N m",
        ),
        (
            ("{log}", "--out", "{tmp}/again.BIN", "--variant", "{tmp}/spin.toml"),
            2,
            "the simulated rover overturns or spins",
        ),
        (("{tmp}/old.BIN", "--out", "{tmp}/again.BIN"), 3, "is empty"),
        (
            ("{log}", "--out", "{tmp}/again.BIN", "--simulator", "ardurover", "--ardurover", "{tmp}/no"),
            4,
            "is not an executable program",
        ),
    ],
)
def test_refusals_are_one_sentence_and_leave_nothing(data, tmp_path, capsys, arguments, code, said):
    (tmp_path / "old.BIN").write_bytes(b"")
    (tmp_path / "bad.toml").write_text('base = "nominal"\n[effects]\nslack = { b = 1 }\n')
    ice = 'base = "nominal"\n[effects]\nsurface_change = { ratio = 0.5, t = 3 }\n'
    (tmp_path / "ice.toml").write_text(ice)
    (tmp_path / "rub.toml").write_text('base = "nominal"\n[effects]\nsuspension_friction = { T = 100 }\n')
    slips = "yaw_inertia = 1e-6\nfront_cornering_stiffness = 1e-3\nrear_cornering_stiffness = 1e-3\n"
    (tmp_path / "spin.toml").write_text(f'base = "nominal"\n{slips}')
    given = [a.format(log=data / RUN, tmp=tmp_path) for a in arguments]
    assert run(["redrive", *given]) == code
    printed = [line for line in capsys.readouterr().err.splitlines() if line.startswith("rover-sweep: ")]
    assert len(printed) == 1 and said in printed[0]
    assert not (tmp_path / "again.BIN").exists()


def test_a_full_disk_is_one_sentence_and_leaves_nothing(data: Path, tmp_path: Path) -> None:
    """No file may grow beyond 40 000 bytes."""
    program = (
        "import resource, sys\n"
        "from rover_sweep.cli.main import run\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))\n"
        "sys.exit(run(sys.argv[1:]))"
    )
    out = tmp_path / "out" / "again.BIN"
    out.parent.mkdir()
    given = ["redrive", str(data / RUN), "--out", str(out)]
    ended = subprocess.run([sys.executable, "-c", program, *given], capture_output=True, text=True)
    assert ended.returncode == 2 and "Traceback" not in ended.stderr
    assert f"{out} cannot be written: " in ended.stderr.splitlines()[-1]
    assert not list(out.parent.iterdir())


def test_says_whose_numbers_it_takes(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "loose.toml").write_text('base = "nominal"\n[effects]\nsteering_backlash = { b = 0.012 }\n')
    out = tmp_path / "again.BIN"
    options = ["--variant", str(tmp_path / "loose.toml"), "--vehicle", str(data / "rover.toml")]
    assert run(["redrive", str(data / RUN), *options, "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert "loose.toml" in printed.err and "rover.toml" in printed.err and "Izz 0.069" in printed.err
    assert "steering_backlash (b 0.012)" in printed.err
    assert "simulated minus recorded speed: mean" in printed.out


def test_a_vehicle_file_replaces_what_it_measured_and_nothing_else(data: Path) -> None:
    rover, nominal = simulated_rover("nominal", str(data / "rover.toml")), load_variant("nominal")
    assert rover.yaw_inertia == 0.069
    assert (rover.front_cornering_stiffness, rover.servo_lag) == (31.0, nominal.servo_lag)


def test_an_instant_counts_from_the_start_of_its_run(data: Path, tmp_path: Path) -> None:
    runs = read_runs(str(data / RUN))

    def changed(text: str) -> object:
        (tmp_path / "v.toml").write_text(f'base = "nominal"\n[effects]\nsurface_change = {{ {text} }}\n')
        return on_the_clock(load_variant(tmp_path / "v.toml"), runs).effects.get("surface_change")

    at = runs[0].span[0] + 3.0
    assert changed("ratio = 0.8, t = 3.0") == {"ratio": 0.8, "t": at}
    assert changed(f'ratio = 0.8, t = 3.0, run = "{runs[0].name}"') == {
        "ratio": 0.8,
        "t": at,
        "run": runs[0].name,
    }
    assert changed('ratio = 0.8, t = 3.0, run = "another"') is None
    assert changed("ratio = 0.8, distance = 9.0") == {"ratio": 0.8, "distance": 9.0}


def test_a_variant_comes_back_from_its_text(tmp_path: Path) -> None:
    source, copy = tmp_path / "a.toml", tmp_path / "b.toml"
    source.write_text(
        'base = "paper"\n[effects]\nimu_offset = { x = 0.1 }\n'
        'clock_offset = { T = 0.1, stream = "velocity" }\n'
    )
    copy.write_text(variant_text(load_variant(source)))
    assert load_variant(copy) == load_variant(source)
