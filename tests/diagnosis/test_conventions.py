"""The result does not depend on signs, units, file names or the order of the runs."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import rover_sweep as rs
from rover_sweep.cli.main import run

SET = Path(__file__).parents[1] / "data" / "concealed-ardurover" / "c"
RATE = 200.0  # Hz
ISO = """
time = "t"
r = "r"
p = "p"
ay = "ay"
vy = "vy"
speed = "speed"
psi = "psi"
delta = "delta"
axes = "iso"
sampling = "step"
filters = {gyro_hz = 20, accel_hz = 20}
"""
FRD = """
time = {column = "ms", unit = "ms"}
r = {column = "gz", unit = "deg/s"}
p = {column = "gx", unit = "deg/s"}
ay = {column = "ay", unit = "g"}
vy = {column = "right", unit = "ft/s"}
speed = {column = "forward", unit = "km/h"}
psi = {column = "yaw", unit = "deg"}
delta = {column = "to the right", unit = "deg"}
axes = "frd"
sampling = "step"
filters = {gyro_hz = 20, accel_hz = 20}
"""
DRESS = {  # of the second file: column, factor from SI and ISO
    "t": ("ms", 1e3),
    "r": ("gz", -180 / np.pi),
    "p": ("gx", 180 / np.pi),
    "ay": ("ay", -1 / 9.80665),
    "vy": ("right", -1 / 0.3048),
    "speed": ("forward", 3.6),
    "psi": ("yaw", -180 / np.pi),
    "delta": ("to the right", -180 / np.pi),
}


def write(path: Path, table: dict[str, np.ndarray]) -> str:
    with path.open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(table)
        out.writerows([f"{x:.10g}" for x in row] for row in zip(*table.values(), strict=True))
    return str(path)


def found(runs: list[str], columns: str, folder: Path) -> dict[str, dict[str, float]]:
    """{effect: {parameter: value}} of a diagnosis of tables."""
    (folder / "columns.toml").write_text(columns)
    out = folder / "out"
    code = run(
        [
            "diagnose",
            *runs,
            "--columns",
            str(folder / "columns.toml"),
            "--vehicle",
            str(SET / "rover.toml"),
            "--only",
            "tyre_relaxation,servo_lag,transport_delay,imu_offset,front_rear_stiffness",
            "--out",
            str(out),
        ]
    )
    assert code == 0
    findings = json.loads((out / "diagnosis.json").read_text())["findings"]
    return {f["effect"]: {n: p["value"] for n, p in f["parameters"].items()} for f in findings}


@pytest.mark.slow
def test_another_dress_of_the_same_runs_changes_no_name(tmp_path: Path) -> None:
    plain, dressed = tmp_path / "plain", tmp_path / "dressed"
    plain.mkdir(), dressed.mkdir()
    names: tuple[list[str], list[str]] = ([], [])
    for k, one in enumerate(
        rs.read(*(str(SET / f"run{n}.BIN") for n in (1, 2, 3)), vehicle=str(SET / "rover.toml"))
    ):
        start, end = one.span
        t = np.arange(start - 4.0, end + 4.0, 1 / RATE)
        table = {"t": t, **{c: one[c].on(t) for c in DRESS if c != "t"}}
        names[0].append(write(plain / f"run{k + 1}.csv", table))
        other = {column: factor * table[c] for c, (column, factor) in DRESS.items()}
        names[1].insert(0, write(dressed / f"zz{7 * k % 5}-morning.csv", other))
    before, after = found(names[0], ISO, plain), found(names[1], FRD, dressed)
    assert list(before) == list(after) == ["tyre_relaxation"]
    assert after["tyre_relaxation"]["sigma"] == pytest.approx(before["tyre_relaxation"]["sigma"], rel=0.01)
