"""Public recordings through `rs.identify_driving`, beside a fit that shares no code with it.

    python -m tests.benchmarks.gallery CHECKOUTS CARS   # the rows of docs/gallery.md
    python -m tests.benchmarks.gallery CHECKOUTS CARS --why   # what it says on where they differ

CHECKOUTS: a folder with clones of the repositories of SETS, by their names; CARS: the folder with the
prepared tables umich_*.csv and dart_*.csv (see tests/data/cars). Neither is part of this repository.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import lfilter

import rover_sweep as rs
from rover_sweep.logs.read import read_logs

MAPS = Path(__file__).parents[1] / "data/cars"

CHANNELS = {"time": "t", "delta": "delta", "r": "r", "speed": "v", "runs": "whole"}
STEP = 0.02  # s
HOLE, SLIDING = 0.3, 6.0  # s, and m/s^2


@dataclass(frozen=True)
class Set:
    """A recording: title, source (repository @ commit, licence), what is known of it, how to read it."""

    title: str
    source: str
    known: str
    table: Callable[[Path], pd.DataFrame]
    column: str = "delta"


def race(path: str, checkouts: Path) -> pd.DataFrame:
    """Of linklab-uva/deep-dynamics: t, delta, r, v."""
    d = pd.read_csv(checkouts / "deep-dynamics/deep_dynamics/data" / path)
    d.columns = [c.strip("# ").split("(")[0] for c in d.columns]
    return pd.DataFrame({"t": d.time - d.time[0], "delta": d.delta, "r": d.omega, "v": d.vx})


def friction(number: int, checkouts: Path) -> pd.DataFrame:
    """Of AhmadAmine998/FrictionMaps: commands held, odometry interpolated to the IMU's stamps."""
    folder = checkouts / f"FrictionMaps/DataSets/DS{number}"
    command, imu, odometry = (pd.read_csv(folder / f"{n}Data.csv") for n in ("command", "imu", "odom"))
    tc, ti, to = ((d.s - imu.s[0] + 1e-9 * d.ns).to_numpy() for d in (command, imu, odometry))
    last = np.searchsorted(tc, ti, side="right") - 1
    use = (last >= 0) & np.concatenate(([True], np.diff(ti) > 1e-4))
    delta, v = command.delta.to_numpy()[last[use]], np.interp(ti[use], to, odometry.vx)
    return pd.DataFrame({"t": ti[use], "delta": delta, "r": np.radians(imu.wz.to_numpy()[use]), "v": v})


def car(name: str, cars: Path) -> pd.DataFrame:
    """A prepared table, read by its column map in tests/data/cars; its trials lie apart on its clock."""
    logs = read_logs(str(cars / f"{name}.csv"), column_map=str(MAPS / f"{name}.columns.toml"))
    parts = []
    for log in logs:
        steering, t = log.steering[0], log.signals["r"].t
        x = np.interp(t, steering.t, steering.x)
        v = np.interp(t, log.signals["speed"].t, log.signals["speed"].x)
        column = "pwm" if steering.unit == "us" else "delta"
        parts.append(pd.DataFrame({"t": t, column: x, "r": log.signals["r"].x, "v": v}))
    return pd.concat(parts).sort_values("t")


RACE = "linklab-uva/deep-dynamics @ 88c8565, GPL-3.0"
MAPPED = "AhmadAmine998/FrictionMaps @ 6a1b907, MIT"
DART = "Lorenzo-Lyons/DART @ 4b52523, MIT"
UMICH = "skvaskov/Rover_Data @ b52f855, no licence given"
SETS = (
    Set("race car, Las Vegas oval", RACE, "Indy car, 2.97 m", partial(race, "LVMS_23_01_04_B.csv")),
    Set("race car, Putnam Park", RACE, "the same car", partial(race, "Putnam_park2023_run4_2.csv")),
    *(Set(f"F1/10 car, set {k}", MAPPED, "1:10 car, 0.33 m", partial(friction, k)) for k in (1, 2, 3, 4, 5)),
)
CARS = (
    Set("rover by joystick, Michigan", UMICH, "1:10 car", partial(car, "umich_nvidia_rover_joystick_2017")),
    Set(
        "ArduPilot rover, circles",
        UMICH,
        "1:10 car; steering at 1280, 1580 and 1880 us only",
        partial(car, "umich_ardupilot_rover_circles_2017"),
        "pwm",
    ),
    Set(
        "DART, by hand",
        DART,
        "1:10 car, 0.174 m; angle from the servo command, good to 20 %, its curve bends",
        partial(car, "dart_free_driving_2024"),
    ),
)


def other_fit(d: pd.DataFrame, column: str, understeer: bool = False) -> tuple[float, float]:
    """(gain [1/m per unit], delay and lag together [s]) of the least squares over a grid of both.

    understeer: with a term of V^3 times the steering.

    The squares are those of the curvature r/V: the speeds then count by the steering's square, as in the
    speed for which the tool says its response time. Those of r would count fast turns by V^2 more.
    """
    t = np.arange(d.t.iloc[0], d.t.iloc[-1], STEP)
    r, v = np.interp(t, d.t, d.r), np.interp(t, d.t, d.v)
    hole = np.diff(d.t)[np.clip(np.searchsorted(d.t, t), 1, len(d) - 1) - 1] > HOLE
    # with a second around them: single samples would take the peaks from the turns, and shift them
    bad = np.convolve(hole | (np.abs(v * r) > SLIDING), np.ones(round(2 / STEP) + 1), "same") > 0.5
    use = (np.abs(v) > 0.3) & ~bad
    weight = 1 / np.abs(v[use])
    best = (np.inf, 0.0, 0.0)
    for delay in np.arange(0, 0.4, STEP):
        u = np.interp(t - delay, d.t, d[column])
        for lag in (0.001, 0.01, *np.arange(0.02, 0.12, 0.015), 0.13, 0.155, 0.18, 0.21, 0.25, 0.3, 0.35):
            share = np.exp(-STEP / lag)
            terms = (v * u, v, v**3 * u) if understeer else (v * u, v)
            x = [lfilter([1 - share], [1, -share], each)[use] for each in terms]
            a = np.column_stack((*x, np.ones(int(use.sum())))) * weight[:, None]
            weights = np.linalg.lstsq(a, r[use] * weight, rcond=None)[0]
            error = float(np.var(r[use] * weight - a @ weights))
            best = min(best, (error, float(weights[0]), float(delay + lag)))
    return best[1], best[2]


def rows(sets: tuple[Set, ...], folder: Path) -> Iterator[str]:
    """A line of the page for each set."""
    for one in sets:
        d = one.table(folder)
        d = d[np.concatenate(([True], np.diff(d.t) > 1e-6))]
        with tempfile.TemporaryDirectory() as place:
            path = Path(place) / "drive.csv"
            d.to_csv(path, index=False)
            columns = {k: v for k, v in CHANNELS.items() if k != "delta"} | {one.column: one.column}
            answer = rs.identify_driving(path, columns=columns)
        gain, late = other_fit(d, one.column)
        said, n = answer.level, answer.numbers
        told, other = "", f"{1 / abs(gain):.3g} m" if one.column == "delta" else f"{100 * abs(gain):.3g} 1/m"
        time = ""
        if answer.level == "none":
            said = f"none: {answer.reasons[0]}"
        else:
            q = n["wheelbase_seen"] if one.column == "delta" else n["curvature"]
            told = f"{q.value:.3g} ({q.low:.3g} to {q.high:.3g}) {'m' if one.column == 'delta' else '1/m'}"
            time = "unknown"
            if "response_time" in n:
                q = n["response_time"]
                time = f"{q.value:.3f} ({q.low:.3f} to {q.high:.3f})"
        first = f"| {one.title} ({one.source}) | {one.known} | {said} "
        yield f"{first}| {told} | {other} | {time} | {late:.2f} |"


def why(checkouts: Path) -> Iterator[str]:
    """Putnam Park's wheelbase at some speeds (least squares of r/V), and set 5 with understeer."""
    d = race("Putnam_park2023_run4_2.csv", checkouts)
    u = np.interp(d.t - other_fit(d, "delta")[1], d.t, d.delta)
    for low, high in ((2, 7), (7, 11), (11, 20), (20, 30)):
        now = ((d.v > low) & (d.v < high)).to_numpy()
        curved, fit = (d.r / d.v).to_numpy()[now], np.polyfit(u[now], (d.r / d.v)[now], 1)
        left = np.var(curved - np.polyval(fit, u[now])) / np.var(curved)
        yield f"Putnam Park, {low} to {high} m/s: {1 / fit[0]:.2f} m (R² {1 - left:.3f})"
    d = friction(5, checkouts)
    d = d[np.concatenate(([True], np.diff(d.t) > 1e-6))]
    for words, term in (("straight", False), ("with understeer", True)):
        yield f"F1/10 car, set 5, other fit {words}: {1 / abs(other_fit(d, 'delta', term)[0]):.3f} m"


def main() -> None:
    """Writes the rows of the page to stdout."""
    checkouts, cars = (Path(word) for word in sys.argv[1:3])
    if "--why" in sys.argv:
        print(*why(checkouts), sep="\n")
        return
    for sets, folder in ((SETS, checkouts), (CARS, cars)):
        for row in rows(sets, folder):
            print(row, flush=True)


if __name__ == "__main__":
    main()
