"""Sizes that show plainly, from runs of one sweep of the engine itself.

As in `tests.foreign.sizing`: undisturbed runs with and without the effect, up to 6 Hz in r, a_y, p (V_y for
effects of the velocity); the part that tyre stiffness, inertias, height above the roll axis, springs,
steering gain, delay and constants could imitate is projected out. What remains of the most affected channel,
in rms over the rms of the noise, is the visibility. One sweep is enough: the one in which the effect begins,
else the large one.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import isfinite

import numpy as np
from numpy.random import Generator
from scipy.signal import butter, sosfiltfilt

from tests.engines.engine import Array, Engine, driven
from tests.engines.rover import EngineRover
from tests.foreign.drive import Drive
from tests.foreign.law import Extras, Law
from tests.foreign.motion import DT
from tests.foreign.sizing import BAND_HZ, CHANNELS, EVERY, Scale, chosen

NOT_FIRST = 2  # the large sweep


@dataclass
class Sizing:
    """Scales of the runs of one rover; each is simulated when it is first asked for."""

    engine: Engine
    rover: EngineRover
    plan: tuple[Drive, ...]
    rng: Generator
    _scales: dict[int, Scale] = field(default_factory=dict)

    def scale(self, run: int) -> Scale:
        """The nominal sweep of a run (1, 2, 3), its noise and what parameters change in it."""
        if run not in self._scales:
            self._scales[run] = self._measured(self.plan[run - 1])
        return self._scales[run]

    def _measured(self, drive: Drive) -> Scale:
        plain = self._run(self.rover, drive)
        noisy = self._run(self.rover, drive, self.rng)
        noise = np.std(noisy - plain, axis=1)
        n = self.rover.numbers
        others = (
            self.rover.of(Cf=1.05 * n.Cf, Cr=1.05 * n.Cr),
            self.rover.of(Izz=1.05 * n.Izz),
            self.rover.of(kphi=1.05 * n.kphi),
            self.rover.of(bphi=1.1 * n.bphi),
            self.rover.of(h=1.1 * n.h),
            self.rover.of(Ixx=1.1 * n.Ixx),
            replace(self.rover, rad_per_us=1.02 * self.rover.rad_per_us),
        )
        changes = [self._run(one, drive) - plain for one in others]
        changes.append(np.gradient(plain, EVERY * DT, axis=1) * 0.004)  # of a delay
        scaled = tuple(one / noise[:, None] for one in changes)
        return Scale((drive,), plain / noise[:, None], noise, scaled)

    def _run(self, rover: EngineRover, drive: Drive, rng: Generator | None = None) -> Array:
        found = driven(self.engine, rover, drive, rng or np.random.default_rng(0), rng is not None)[2]
        inside = slice(round(drive.begin / DT), round(drive.end / DT), EVERY)
        rows = np.array([found[name][inside] for name in CHANNELS])
        if not np.all(np.isfinite(rows)):
            return np.full(rows.shape, np.nan)
        return np.asarray(sosfiltfilt(butter(4, BAND_HZ * 2 * DT * EVERY, output="sos"), rows, axis=1))

    def visibility(self, law: Law, size: float, extras: Extras) -> float:
        """Of the effect at this size; inf where the rover is out of control."""
        scale = self.scale(int(extras.get("run", NOT_FIRST)))
        changed = law.apply(self.rover, size, extras)
        return scale.visibility(self._run(changed, scale.plan[0]) / scale.noise[:, None], law)

    def in_control(self, law: Law, concealed: EngineRover) -> bool:
        """Whether a rover with several effects, the last of them `law`, still drives its large sweep."""
        scale = self.scale(NOT_FIRST)
        return isfinite(scale.visibility(self._run(concealed, scale.plan[0]) / scale.noise[:, None], law))

    def sized(self, law: Law, extras: Extras, rng: Generator) -> tuple[float, float] | None:
        """(size, visibility) that shows plainly; None if no size does."""

        def seen(size: float) -> float:
            return self.visibility(law, size, extras)

        return chosen(seen, law, rng, searches=5, near=0.3)  # an engine takes seconds
