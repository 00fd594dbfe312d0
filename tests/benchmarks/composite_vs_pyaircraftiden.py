"""Composite of thousands of frequencies: pyAircraftIden beside this project on the same record.

    OPENBLAS_NUM_THREADS=1 PYTHONPATH=. \\
        python tests/benchmarks/composite_vs_pyaircraftiden.py CHECKOUT sweep.npy [--frequencies 8762]

CHECKOUT: a clone of github.com/xuhao1/pyAircraftIden (MIT). sweep.npy: columns 0 time [s], 1 elevator,
4 pitch rate. Both sides take the same samples, windows and frequencies and end with composite Gxx, Gyy,
Gxy. pyAircraftIden interpolates its windows' spectra to the frequencies asked for (0: its own grid) and
uses all cores; one thread for the matrix products serves both sides best where other work is running.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import sys
import time
import types
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.data.recording import Array, Recording, Signal
from rover_sweep.spectra.response import FrequencyResponse, composite, frequency_responses
from rover_sweep.spectra.windowed import window_spectra

BAND = (1.0, 30.0)  # rad/s
REPEATS = 5


@dataclass(frozen=True)
class Peer:
    """What pyAircraftIden found: h and coherence at w [rad/s], its windows [s], its time [s]."""

    w: Array
    h: np.ndarray
    coherence: Array
    windows: tuple[float, ...]
    seconds: float


def peer_classes(checkout: Path) -> tuple[Any, Any]:
    """FreqIdenSIMO and CompositeWindow, past the package's __init__, which wants sympy."""
    if not (checkout / "AircraftIden" / "CompositeWindow.py").is_file():
        sys.exit(
            f"{checkout} holds no AircraftIden/CompositeWindow.py; clone github.com/xuhao1/pyAircraftIden"
        )
    package = types.ModuleType("AircraftIden")
    package.__path__ = [str(checkout / "AircraftIden")]
    sys.modules["AircraftIden"] = package
    importlib.import_module("matplotlib").use("Agg")
    module = importlib.import_module("AircraftIden.FreqIden")
    return module.FreqIdenSIMO, module.CompositeWindow


def peer_composite(checkout: Path, run: Recording, frequencies: int) -> Peer:
    whole, window = peer_classes(checkout)
    if frequencies:

        def asked(self: Any) -> Array:
            self.freq = np.linspace(*BAND, frequencies)
            return self.freq

        window.get_freq_points = asked
    x, y = run["delta"], run["q"]
    with contextlib.redirect_stdout(io.StringIO()):
        begin = time.perf_counter()
        found = whole(x.t, *BAND, x.x.copy(), y.x.copy())
        seconds = time.perf_counter() - begin
    w, h, coherence, *_ = found.get_freq_iden(0)
    part = found.composes[0]
    lengths = tuple(s.per_win_time for s in part.specturmAnallist)
    return Peer(w, h, coherence, lengths, seconds)


def ours(run: Recording, w: Array, windows: tuple[float, ...]) -> tuple[FrequencyResponse, float, float]:
    """The response, the median time [s] of all of it, and of the composite alone."""
    everything, alone = [], []
    channels = {name: run.manoeuvre(name) for name in run.channels}
    spectra = window_spectra([channels], [run.span], ["q"], windows, w)["q"]
    for _ in range(REPEATS):
        begin = time.perf_counter()
        found = frequency_responses([run], ["q"], w, windows)["q"]
        middle = time.perf_counter()
        composite(spectra)
        everything.append(middle - begin)
        alone.append(time.perf_counter() - middle)
    return found, float(np.median(everything)), float(np.median(alone))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkout", type=Path)
    parser.add_argument("sweep", type=Path)
    parser.add_argument("--frequencies", type=int, default=8762)
    asked = parser.parse_args()
    columns = np.load(asked.sweep)
    t = columns[:, 0]
    channels = {"delta": Signal(t, columns[:, 1], ""), "q": Signal(t, columns[:, 4], "deg/s")}
    run = Recording(asked.sweep.stem, channels, (float(t[0]), float(t[-1])), "sweep")
    peer = peer_composite(asked.checkout, run, asked.frequencies)
    found, seconds, alone = ours(run, peer.w, peer.windows)
    windows = ", ".join(f"{length:.3g}" for length in peer.windows)
    print(
        f"{peer.w.size} frequencies {peer.w[0]:g}-{peer.w[-1]:g} rad/s, windows {windows} s, {t.size} samples"
    )
    print(f"pyAircraftIden  {peer.seconds:8.2f} s")
    print(f"rover-sweep     {seconds:8.2f} s (composite alone {alone:.2f} s), median of {REPEATS}")
    print(f"ratio           {peer.seconds / seconds:8.0f}")
    ratio = found.h / peer.h
    db, degrees = np.abs(20 * np.log10(np.abs(ratio))), np.abs(np.degrees(np.angle(ratio)))
    for name, difference in (("magnitude, dB", db), ("phase, deg", degrees)):
        middle, high = np.percentile(difference, [50, 95])
        print(f"difference in {name}: median {middle:.3f}, 95 % below {high:.3f}")
    print(f"coherence, median: {np.median(peer.coherence):.4f} there, {np.median(found.coherence):.4f} here")


if __name__ == "__main__":
    main()
