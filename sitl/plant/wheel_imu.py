"""An IMU on the front wheel, written as a growing CSV file, to test the steering bench.

Columns t [s, the vehicle's clock] and angle [rad, left positive]: heading and road-wheel angle together,
since the IMU turns with the rover too.
"""

from __future__ import annotations

import random
from pathlib import Path

from sitl.plant.plant import PlantState

INTERVAL = 0.005  # s
NOISE = 0.001  # rad


class WheelImu:
    """Writes to `path`; begins it anew. seed: of the noise."""

    def __init__(self, path: Path, seed: int = 1) -> None:
        self._file = path.open("w", buffering=1, encoding="ascii")
        self._file.write("t,angle\n")
        self._random = random.Random(seed)
        self._next = 0.0

    def sample(self, t: float, state: PlantState) -> None:
        """The state at vehicle time t [s]; kept 200 times a second."""
        if t < self._next:
            return
        self._next = t + INTERVAL - 1e-6
        self._file.write(f"{t:.6f},{state.psi + state.delta + self._random.gauss(0.0, NOISE):.6f}\n")

    def close(self) -> None:
        self._file.close()
