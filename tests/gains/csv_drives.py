"""The recorded drives as .csv files of another system: with the steering's command, or the wheels' angle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

import rover_sweep as rs
from rover_sweep.data.recording import Array, Signal

DATA = Path(__file__).parents[1] / "data"
NOMINAL = DATA / "ardurover-4.6.3" / "nominal"
LAG, DELAY = 0.022, 0.015  # s, of the servo of the plant behind the recordings
FILTERS = "filters = {gyro_hz = 20, accel_hz = 20}\n"
SERVO = "servo_lag = { value = 0.022, sd = 0.002 }\nservo_delay = { value = 0.015, sd = 0.001 }\n"


def behind_the_servo(command: Signal, t: Array) -> Array:
    """The road-wheel angle (n,) at t (n,) of a servo with that lag and delay."""
    step = 0.001
    grid = np.arange(command.t[0], command.t[-1], step)
    held = command.x[np.searchsorted(command.t, grid, "right") - 1]
    decay = math.exp(-step / LAG)
    turned = lfilter([1 - decay], [1.0, -decay], held, zi=[decay * held[0]])[0]
    return np.interp(t - DELAY, grid, turned)


def as_csv(
    folder: Path, names: Sequence[str] = ("run1", "run2", "run4"), measured: bool = False
) -> list[Path]:
    """The drives with a column "angle" in rad: the command at each row, or the angle of the wheels."""
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    for name in names:
        (run,) = rs.read(NOMINAL / f"{name}.BIN", vehicle=DATA / "rover.toml")
        r, command = run["r"], run["delta"]
        inside = (r.t > max(s.t[0] for s in run.channels.values()) + 0.1) & (
            r.t < min(s.t[-1] for s in run.channels.values()) - 0.1
        )
        t = r.t[inside]
        held = command.x[np.searchsorted(command.t, t, "right") - 1]
        angle = behind_the_servo(command, t) if measured else held
        columns = [t, angle, *(run[c].on(t) for c in ("r", "ay", "p", "speed"))]
        path = folder / f"{name}.csv"
        rows = np.stack(columns, 1)
        np.savetxt(path, rows, "%.7g", delimiter=",", header="time,angle,r,ay,p,speed", comments="")
        found.append(path)
    return found


def column_map(folder: Path, origin: str) -> Path:
    """A column map that says this origin of the angle; "" for none."""
    own = f', origin = "{origin}"' if origin else ""
    lines = [f'{c} = "{c}"' for c in ("time", "r", "ay", "p", "speed")]
    step = 'sampling = "step"' if origin != "measured" else ""
    path = folder / f"columns-{origin or 'none'}.toml"
    path.write_text("\n".join((*lines, f'delta = {{column = "angle"{own}}}', step, FILTERS)))
    return path


def vehicle_file(folder: Path, servo: bool) -> Path:
    """The vehicle file of the recordings, with the numbers of the servo or without."""
    text = (DATA / "rover.toml").read_text()
    assert "[steering]\n" in text
    path = folder / f"rover-{'with' if servo else 'without'}-servo.toml"
    path.write_text(text.replace("[steering]\n", f"[steering]\n{SERVO}") if servo else text)
    return path
