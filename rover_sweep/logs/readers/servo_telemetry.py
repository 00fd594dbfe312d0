"""The measured position of the steering servo (CSRV), in us of its output.

A servo on CAN or Volz' bus reports its position in a unit of its own: degrees, radians, a share of the travel
or us (AP_DroneCAN handle_actuator_status and handle_himark_servoinfo, AP_PiccoloCAN, AP_Servo_Telem of 4.7).
So scale and offset are fitted: at low frequency the servo reaches its command. With them the lag and the
delay of the servo are found. What is behind the servo (linkage, tyres) is not in the position.
"""

from __future__ import annotations

import math

import numpy as np

from rover_sweep.data.recording import Array, Note, Signal
from rover_sweep.logs.log import increasing
from rover_sweep.logs.readers.dataflash import DataFlash

STEP = 0.005  # s, grid of the command
LAGS = (0.0, *np.geomspace(0.005, 0.3, 14))  # s
DELAYS = np.arange(0.0, 0.2, STEP)  # s
MOST = 6000  # samples of the position that are fitted
LEAST_FIT = 0.9  # of the variance of the position; less is another servo
LEAST_SAMPLES = 20


def servo_position(flash: DataFlash, output: int, command: Signal) -> tuple[Signal, Note] | None:
    """(position [us], note with its lag and delay) of the servo on an output (1-based) with a command [us].

    None if the log has no position that follows the command. DroneCAN counts servos from 1, PiccoloCAN and
    4.7 from 0.
    """
    if not flash.has("CSRV", "Id", "Pos"):
        return None
    number, position = flash.column("CSRV", "Id"), flash.column("CSRV", "Pos")
    best: tuple[float, Signal, float, float] | None = None
    for servo in (output, output - 1):
        own = (number == servo) & np.isfinite(position)
        t, (x,) = increasing(flash.seconds("CSRV")[own], position[own])
        inside = (t >= command.t[0]) & (t <= command.t[-1])
        if inside.sum() >= LEAST_SAMPLES and np.ptp(x[inside]) > 0 and np.ptp(command.x) > 0:
            share, scale, offset, lag, delay = _fitted(t[inside], x[inside], command)
            if share >= LEAST_FIT and (best is None or share > best[0]):
                best = share, Signal(t, (x - offset) / scale, "us", "CSRV.Pos"), lag, delay
    if best is None:
        return None
    share, signal, lag, delay = best
    rest = math.sqrt(1 - share) * float(np.std(signal.x))
    return signal, Note(
        "info",
        f"The servo follows the steering output with a delay of {1e3 * delay:.0f} ms and a lag of "
        f"{1e3 * lag:.0f} ms (rest {rest:.1f} us rms), measured by its telemetry (CSRV)",
    )


def _fitted(t: Array, x: Array, command: Signal) -> tuple[float, float, float, float, float]:
    """(explained share of the variance, scale, offset, lag [s], delay [s]) of positions x (n,) at t (n,)."""
    from scipy.signal import lfilter  # slow to import, and most logs have no such telemetry

    every = max(t.size // MOST, 1)
    t, x = t[::every], x[::every]
    grid = np.arange(command.t[0], command.t[-1] + STEP, STEP)
    wanted = command.on(grid)
    best = (-math.inf, 1.0, 0.0, 0.0, 0.0)
    for lag in LAGS:
        decay = math.exp(-STEP / lag) if lag else 0.0
        lagged = lfilter([1 - decay], [1.0, -decay], wanted, zi=[decay * wanted[0]])[0]
        for delay in DELAYS:
            u = np.interp(t - delay, grid, lagged)
            spread = float(np.var(u))
            if spread == 0.0:
                continue
            scale = float(np.mean((u - u.mean()) * (x - x.mean()))) / spread
            share = scale**2 * spread / float(np.var(x))
            if share > best[0] and scale != 0.0:
                best = share, scale, float(x.mean() - scale * u.mean()), float(lag), float(delay)
    return best
