"""Draw the pictures of the documentation: `python docs/draw_pictures.py`, from the top of a checkout.

models.svg and verification-run4.svg are pictures of the report that `identify` writes for the recorded
nominal rover. proof.svg shows what the tool is for: the same turns on the official firmware with its default
gains and with the proposed ones, as recorded; and the side force of the tyres that `diagnose` found in a
rover whose tyres slide, beside the law that its simulator has and the tool does not.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import rover_sweep as rs
from rover_sweep.cli.main import run
from rover_sweep.data.geometry import STANDARD_GRAVITY
from rover_sweep.logs.readers.dataflash import open_parts

HERE = Path(__file__).parent
NOMINAL = HERE.parent / "tests/data/ardurover-4.6.3/nominal"
TURNS = HERE.parent / "tests/data/gains/ardurover-4.6.3/acro.BIN"
PICTURES = ("models.svg", "verification-run4.svg")
SPEED = 2.45  # m/s, of the recorded turns
SHOWN = 5.0  # s of them: one corner of 90 degrees
CONCEALED = 45  # seed of a drawn rover of the foreign plant: tanh tyres that slide at .34 g
COLOURS = {"default": "#B5452C", "proposed": "#1F6FA8"}


def draw() -> None:
    """Write all pictures into docs/pictures."""
    with tempfile.TemporaryDirectory() as folder:
        sweeps = [str(NOMINAL / f"run{n}.BIN") for n in (1, 2)]
        vehicle = ["--vehicle", str(HERE.parent / "tests/data/rover.toml")]
        code = run(["identify", *sweeps, "--verify", str(NOMINAL / "run4.BIN"), *vehicle, "--out", folder])
        if code:
            sys.exit(code)
        for name in PICTURES:
            shutil.copy(Path(folder) / "pictures" / name, HERE / "pictures" / name)
    proof(HERE / "pictures" / "proof.svg")


def proof(out: Path) -> None:
    """The picture of the README."""
    matplotlib.rcParams |= {"font.size": 9, "svg.hashsalt": "proof", "axes.grid": True, "grid.alpha": 0.3}
    figure = Figure(figsize=(10.5, 3.4), layout="constrained")
    rate, path, tyre = figure.subplots(1, 3)
    _turns(rate, path)
    _tyres(tyre)
    figure.savefig(out, metadata={"Date": None})


def _turns(rate: Axes, path: Axes) -> None:
    """Turn rate and path of both segments, PIDS.Tar and PIDS.Act of the firmware."""
    (log,) = open_parts(TURNS)
    rows = log.rows("PIDS")
    t = log.seconds("PIDS", rows)
    wanted, actual = (log.column("PIDS", name, rows) for name in ("Tar", "Act"))
    for segment in json.loads(TURNS.with_suffix(".json").read_text())["segments"]:
        name, start = segment["name"].removesuffix("s"), segment["start_s"]
        part = (t >= start) & (t < start + SHOWN)
        time = t[part] - start
        if name == "default":
            rate.plot(time, np.degrees(wanted[part]), "k--", lw=1, label="wanted")
            path.plot(*_path(time, wanted[part]), "k--", lw=1, label="wanted")
        error = np.degrees(np.sqrt(np.mean((wanted[part] - actual[part]) ** 2)))
        label = f"{name} gains: {error:.1f}°/s rms off"
        rate.plot(time, np.degrees(actual[part]), color=COLOURS[name], label=label)
        path.plot(*_path(time, actual[part]), color=COLOURS[name], label=f"{name} gains")
    rate.set(title="The same corner on ArduRover 4.6.3", xlabel="s", ylabel="turn rate, °/s", ylim=(-14, 34))
    path.set(title=f"Path at {SPEED} m/s", xlabel="right, m", ylabel="ahead, m", aspect="equal")
    for axes in (rate, path):
        axes.legend(fontsize=7, framealpha=0.9)


def _path(t: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(right (n,), ahead (n,)) m of a rover at SPEED with this turn rate (n,) rad/s."""
    dt = np.gradient(t)
    heading = np.cumsum(rate * dt)
    return np.cumsum(SPEED * np.sin(heading) * dt), np.cumsum(SPEED * np.cos(heading) * dt)


def _tyres(axes: Axes) -> None:
    """The front tyres' curve that a diagnosis found, and the law of the concealed rover."""
    sys.path.insert(0, str(HERE.parent))  # for `tests`, which is not installed
    from tests.foreign.laws import LISTED
    from tests.foreign.plant import side_force
    from tests.foreign.recorded import drives, runs_of
    from tests.foreign.rover import SIZES, draw_rover

    rng = np.random.default_rng([1, CONCEALED])
    plain = draw_rover(rng, SIZES[int(rng.integers(len(SIZES)))])
    plan = drives(rng, plain)
    (saturating,) = (law for law in LISTED if (law.effect, law.form) == ("tyre_saturation", "tanh"))
    rover = saturating.apply(plain, saturating.high, {})
    runs, held_out = runs_of(rover, plan, CONCEALED)
    found = rs.diagnose(runs, held_out)
    (curve,) = (c for c in found.curves if c.place == "side force front")
    x, n = np.degrees(curve.x), rover.numbers
    load = n.m * STANDARD_GRAVITY * n.b / (n.a + n.b)
    law: Any = [side_force(a, n.Cf, n.mu * load, n.tyre_form) for a in curve.x]
    axes.fill_between(x, curve.low, curve.high, color="#F2CE8B", label="90 % interval")
    axes.plot(x, curve.y, color="#B5651D", label="found")
    axes.plot(x, law, "k:", lw=1.5, label="law of the simulator")
    axes.plot(x, curve.straight(list(curve.x)), color="#999999", lw=1, ls="--", label="without saturation")
    axes.set(title="Tyre found in a concealed rover", xlabel="front slip angle, °", ylabel="side force, N")
    axes.set_ylim(1.4 * min(law), 1.4 * max(law))
    axes.legend(fontsize=7)


if __name__ == "__main__":
    draw()
