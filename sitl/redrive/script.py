"""A Lua script that plays a recorded drive on a simulated rover, embedded or with the real firmware."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sitl.plant.plant import GRAVITY
from sitl.plant.variant import PlantParameters
from sitl.redrive.course import AppletState, Array, Course

CELL_S, SPEED_CELL_S = 0.01, 0.05
_BODY = Path(__file__).with_name("playback.lua")


def script(course: Course, parameters: PlantParameters) -> str:
    """The whole script. It begins a second after arming and says `REDRIVE: done` when the course is over."""
    q = parameters
    edges = np.arange(course.t[0], course.t[-1], CELL_S)
    speeds_at = np.arange(course.t[0], course.t[-1], SPEED_CELL_S) + 0.5 * SPEED_CELL_S
    speed = np.interp(speeds_at, course.t, course.speed)
    drag = speed + q.speed_lag * np.gradient(speed, SPEED_CELL_S)
    drag += q.rolling_resistance * GRAVITY * q.speed_lag
    standing = speed < 0.15
    feedforward = q.throttle_trim_us + np.where(standing, 0.0, drag / q.speed_per_us)
    states, runs = _states(course.applet, edges)
    lines = (
        f"local DT, SPEED_DT, US_PER_SPEED = {CELL_S}, {SPEED_CELL_S}, {1.0 / q.speed_per_us:.6g}",
        f'local STEERING = "{_digits(_means(course, edges))}"',
        f'local SPEEDS = "{_digits(1000.0 * np.where(standing, 0.0, speed))}"',
        f'local FEEDFORWARD = "{_digits(feedforward)}"',
        f'local STATES = "{states}"',
        f"local RUNS = {{{', '.join(runs)}}}",
    )
    return "\n".join(lines) + "\n" + _BODY.read_text(encoding="utf-8")


def _means(course: Course, edges: Array) -> Array:
    """Mean steering (n,) us over the cells: the script holds a value until its next turn."""
    t, x = course.asked_t, course.asked
    area = np.concatenate(([0.0], np.cumsum(x[:-1] * np.diff(t))))
    ends = np.append(edges, edges[-1] + CELL_S)
    k = np.clip(np.searchsorted(t, ends, "right") - 1, 0, t.size - 1)
    return np.diff(area[k] + x[k] * (ends - t[k])) / CELL_S


def _digits(values: Array) -> str:
    return "".join(f"{min(max(round(x), 0), 9999):04d}" for x in values.tolist())


def _states(applet: AppletState | None, edges: Array) -> tuple[str, list[str]]:
    """The applet's state of each cell as letters, and its runs as Lua tables; nothing without an applet."""
    if applet is None or applet.t.size == 0:
        return "", []
    k = np.clip(np.searchsorted(applet.t, edges + 0.5 * CELL_S, "right") - 1, 0, applet.t.size - 1)
    letters = "".join(chr(65 + int(s)) for s in applet.state[k])
    runs = []
    for number in dict.fromkeys(applet.run.tolist()):
        mine = applet.run == number
        first, last = (np.searchsorted(edges, applet.t[mine][i], "right") - 1 for i in (0, -1))
        moving = mine & (applet.clock > 0)
        offset = float(np.median((applet.clock - (applet.t - edges[0]))[moving])) if moving.any() else 0.0
        runs.append(f"{{{first}, {last}, {int(number)}, {offset:.6f}}}")
    return letters, runs
