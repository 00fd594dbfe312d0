"""Draw the pictures of the documentation: `python docs/draw_pictures.py [PICTURE...]`, in a checkout.

models.svg and verification-run4.svg are pictures of the report that `identify` writes for the recorded
nominal rover; report.png is the top of its page, diagnosis.png that of the page that `diagnose` writes for
the recorded rover c (both need Chromium). session-*.svg are screens of `session`, as the tests play them.
proof.svg shows what the tool is for: a corner on the official firmware with its default gains and with those
after four steps of `gains`, both from one `gains --check` of the recorded drive, and the path, integrated
from recorded turn rate and speed; and the side force of the tyres that `diagnose` found in a rover whose
tyres slide, beside the law that its simulator has and the tool does not.
"""

from __future__ import annotations

import asyncio
import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import rover_sweep as rs
from rover_sweep.api.gains import check_gains
from rover_sweep.cli.main import run
from rover_sweep.data.geometry import STANDARD_GRAVITY

HERE = Path(__file__).parent
OUT = HERE / "pictures"
NOMINAL = HERE.parent / "tests/data/ardurover-4.6.3/nominal"
LEFT_OUT = HERE.parent / "tests/data/concealed-ardurover/c"
TURNS = HERE.parent / "tests/data/gains/ardurover-4.6.3/acro.BIN"
CHARTS = ("models.svg", "verification-run4.svg")
SCREENS = {"preflight": "preflight", "run-steers": "run", "verdict": "verdict"}  # scenes of tests/tui
PAGE = (860, 1000)  # px of a page's top
INKS = 48  # colours of its picture
SHOWN = 5.0  # s of a drive: one corner of 90 degrees
DRIVES = {"defaults": ("#B5452C", "default gains"), "proposed": ("#1F6FA8", "gains after four steps")}
DRAWN = (1, 45)  # seed of a rover of the foreign plant
CONCEALED = {"mu": 0.342945852397455, "tyre_form": 3.0}  # its tyres: tanh, sliding at .34 g


def draw(only: list[str]) -> None:
    """Write all pictures, or those of these names, into docs/pictures."""
    for names, make in (
        ((*CHARTS, "report.png"), identified),
        (("diagnosis.png",), diagnosed),
        (tuple(f"session-{name}.svg" for name in SCREENS.values()), session),
        (("proof.svg",), proof),
    ):
        if not only or set(only) & set(names):
            make()


def identified() -> None:
    """Charts and page of the recorded nominal rover."""
    with tempfile.TemporaryDirectory() as folder:
        sweeps = [str(NOMINAL / f"run{n}.BIN") for n in (1, 2)]
        vehicle = ["--vehicle", str(HERE.parent / "tests/data/rover.toml")]
        _run("identify", *sweeps, "--verify", str(NOMINAL / "run4.BIN"), *vehicle, "--out", folder)
        for name in CHARTS:
            shutil.copy(Path(folder) / "pictures" / name, OUT / name)
        top_of(Path(folder) / "report.html", OUT / "report.png")


def diagnosed() -> None:
    """Page of the recorded rover c."""
    with tempfile.TemporaryDirectory() as folder:
        runs = [str(LEFT_OUT / f"run{n}.BIN") for n in (1, 2, 3)]
        held = ["--hold-out", str(LEFT_OUT / "run4.BIN"), "--vehicle", str(LEFT_OUT / "rover.toml")]
        _run("diagnose", *runs, *held, "--out", folder)
        top_of(Path(folder) / "diagnosis.html", OUT / "diagnosis.png")


def _run(*arguments: str) -> None:
    if code := run(arguments):
        sys.exit(code)


def top_of(page: Path, out: Path) -> None:
    """Write a picture of the top of a page, in few colours; without Chromium the old one stays."""
    from PIL import Image

    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        print(f"{out.name} stays as it is: no chromium", file=sys.stderr)
        return
    width, height = PAGE
    with tempfile.TemporaryDirectory() as folder:
        shot = Path(folder) / "shot.png"
        flags = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars")
        options = (f"--user-data-dir={folder}", f"--window-size={width},{height}", f"--screenshot={shot}")
        subprocess.run([browser, *flags, *options, page.as_uri()], check=True, stderr=subprocess.DEVNULL)
        Image.open(shot).convert("RGB").quantize(INKS).save(out, optimize=True)


def session() -> None:
    """Screens of the session."""
    for scene, name in SCREENS.items():
        (OUT / f"session-{name}.svg").write_text(screen(scene), encoding="utf-8")


def screen(scene: str) -> str:
    """A screen of the session as SVG, without the fonts that it would load from the network."""
    sys.path.insert(0, str(HERE.parent / "tests/tui"))
    from scenes import all_scenes, playing

    async def played() -> str:
        steps, setup = all_scenes()[scene]
        async with playing(steps, setup=setup) as (app, _, _):
            return app.export_screenshot(title="rover-sweep session")

    return re.sub(r"@font-face \{.*?\}\n", "", asyncio.run(played()), flags=re.DOTALL)


def proof() -> None:
    """The picture of the README."""
    matplotlib.rcParams |= {"font.size": 9, "svg.hashsalt": "proof", "axes.grid": True, "grid.alpha": 0.3}
    figure = Figure(figsize=(10.5, 3.4), layout="constrained")
    rate, path, tyre = figure.subplots(1, 3)
    _turns(rate, path)
    _tyres(tyre)
    figure.savefig(OUT / "proof.svg", metadata={"Date": None})


def _turns(rate: Axes, path: Axes) -> None:
    """Turn rate and path of the first corner with either set of gains, from one `gains --check`."""
    checked = check_gains([TURNS])
    starts = {s["name"]: s["start_s"] for s in json.loads(TURNS.with_suffix(".json").read_text())["segments"]}
    pairs = zip(starts.items(), (*checked.before[0], *checked.steering), strict=True)
    for (name, start), check in pairs:
        part = (check.log.t >= start) & (check.log.t < start + SHOWN)
        t, wanted, actual, speed = (
            x[part] for x in (check.log.t, check.log.target, check.log.actual, check.log.speed)
        )
        if name == "defaults":
            rate.plot(t - start, np.degrees(wanted), "k--", lw=1, label="wanted")
            path.plot(*_path(t, wanted, speed), "k--", lw=1, label="wanted")
        error = np.degrees(check.achieved.rms)
        colour, label = DRIVES[name]
        rate.plot(t - start, np.degrees(actual), color=colour, label=f"{label}: {error:.1f}°/s rms off")
        path.plot(*_path(t, actual, speed), color=colour, label=label)
    rate.set(
        title="Turn rate on ArduRover 4.6.3 in SITL", xlabel="s", ylabel="turn rate, °/s", ylim=(-14, 34)
    )
    path.set(title="Path, integrated", xlabel="right, m", ylabel="ahead, m", aspect="equal")
    for axes in (rate, path):
        axes.legend(fontsize=7, framealpha=0.9)


def _path(t: np.ndarray, rate: np.ndarray, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(right (n,), ahead (n,)) m, without sideslip, of turn rate rad/s and speed m/s (n,)."""
    dt = np.gradient(t)
    heading = np.cumsum(rate * dt)
    return np.cumsum(speed * np.sin(heading) * dt), np.cumsum(speed * np.cos(heading) * dt)


def concealed_rover() -> tuple[Any, Any]:
    """The rover whose tyres slide, and the plan of its drives."""
    sys.path.insert(0, str(HERE.parent))  # for `tests`, which is not installed
    from tests.foreign.recorded import drives
    from tests.foreign.rover import SIZES, draw_rover

    rng = np.random.default_rng(DRAWN)
    drawn = draw_rover(rng, SIZES[int(rng.integers(len(SIZES)))])
    return drawn.of(**CONCEALED), drives(rng, drawn)


def _tyres(axes: Axes) -> None:
    """The front tyres' curve that a diagnosis found, and the law of the concealed rover."""
    rover, plan = concealed_rover()
    from tests.foreign.plant import side_force
    from tests.foreign.recorded import runs_of

    runs, held_out = runs_of(rover, plan, DRAWN[1])
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
    draw(sys.argv[1:])
