"""`rover-sweep firmware`: applet and parameters written, a rover checked and set up."""

from __future__ import annotations

from pathlib import Path

from program_calls import RunProgram

from firmware_params.applet_parameters import applet_source
from firmware_params.param_files import shipped
from rover_sweep.vehicle import setup as applet_module


def test_applet_and_parameters_are_written(run_program: RunProgram, tmp_path: Path) -> None:
    assert run_program("firmware", "applet").out == applet_source()
    file = tmp_path / "a.lua"
    done = run_program("firmware", "applet", "-o", str(file))
    assert (done.code, done.out) == (0, "") and file.read_text() == applet_source()
    assert run_program("firmware", "params").out == shipped("identification").read_text()
    assert run_program("firmware", "params", "raw_imu").out == shipped("raw_imu").read_text()
    slip = run_program("firmware", "applet", "-o", str(tmp_path / "scirpts" / "a.lua"))
    assert slip.code == 2 and "there is no folder" in slip.err and not (tmp_path / "scirpts").exists()
    wrong = run_program("firmware", "params", "nonsense")
    assert wrong.code == 2 and "identification" in wrong.err


def test_install_asks_before_it_changes_anything(run_program, fresh, monkeypatch):
    where = ("--connect", fresh.connection)
    file, asked = fresh.directory / "parameters.txt", list[str]()
    before = file.read_text()
    done = run_program("firmware", "check", *where)
    rows = {line.split()[0]: line for line in done.out.splitlines() if line.strip()}
    assert done.code == 1
    assert done.err == f"next: rover-sweep firmware install --connect {fresh.connection}\n"
    assert "differs" in rows["SCHED_LOOP_RATE"] and ">= 100" in rows["SCHED_LOOP_RATE"]
    assert "yes" in rows["SCHED_LOOP_RATE"] and "servo, IMU log" in rows["SCHED_LOOP_RATE"]
    assert "fits" in rows["FS_ACTION"] and "the applet does not run" in done.out
    done = run_program("firmware", "install", *where)  # nobody to ask
    assert done.code == 2 and "give --yes" in done.err
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("click.confirm", lambda *_, **__: False)
    assert run_program("firmware", "install", *where).code == 1
    assert file.read_text() == before
    assert not (fresh.directory / "scripts" / "rover_sweep.lua").exists()
    monkeypatch.setattr("click.confirm", lambda words, **_: [asked.append(words), len(asked) == 1][1])
    done = run_program("firmware", "install", *where)
    assert asked[1] == "Reboot the rover to apply SCR_ENABLE, SCHED_LOOP_RATE?"
    assert "SCHED_LOOP_RATE will take effect after a reboot" in done.err
    assert "STAT_BOOTCNT 1.0" in file.read_text() and "SCHED_LOOP_RATE 100.0" in file.read_text()


def test_an_installed_rover_fits_and_another_applet_does_not(run_program, ready):
    done = run_program("firmware", "check", "--connect", ready.connection)
    assert done.code == 0 and "has everything" in done.out
    assert done.err == f"next: rover-sweep preflight --connect {ready.connection}\n"
    assert f"applet {applet_module.version_of(applet_source())} runs" in done.out
    file = ready.directory / "scripts" / "rover_sweep.lua"
    file.write_text(applet_source().replace('VERSION = "', 'VERSION = "0.'))
    done = run_program("firmware", "check", "--connect", ready.connection)
    assert done.code == 1 and "not this program's applet" in done.out and "version 0." in done.out
    assert run_program("firmware", "install", "--yes", "--connect", ready.connection).code == 0
    assert file.read_text() == applet_source()
