"""How large an effect must be to stand out, from the generator's own equations alone.

`python -m tests.concealed.sizing`.

For rovers drawn anew, the change an effect makes in r, a_y, p and V_y of run1 to run3 is projected off what
the nominal model and the nuisances (each within its spread) can imitate, and whitened by the noise of the
same rover. `gain` is the squared length of what is left, in chi-square units; it grows with the square of
the size. The size is taken where it is GAIN: a residual of 3.5 sigma rms over the 25 independent cells of a
narrow band. An ideal test among 24 candidates needs about 15; a real one meets models that are not exact.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tests.concealed.drive import steer
from tests.concealed.effects import UNKNOWN, Hidden, ids, part
from tests.concealed.motion import STEP
from tests.concealed.run import Roughness, move
from tests.concealed.sensors import measure
from tests.concealed.sets import Case, draw_case, stream

Array = NDArray[np.float64]
GAIN = 300.0
BAND = 0.3, 30.0  # rad/s
SMOOTHED = 60  # bins over which the noise's power is averaged
QUIET = Roughness(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

FREE = 30.0  # sd of a parameter that the fit finds, relative
# One row a nuisance: what moves, in which proportion, and its spread, relative to the first one's value.
NUISANCES: tuple[tuple[str, dict[str, float], float], ...] = (
    ("rover", {"cf": 1, "cr": 1}, FREE),
    ("rover", {"cf": 1, "cr": -1}, 0.06),
    ("rover", {"a": 1, "b": -1}, 0.03),
    ("rover", {"izz": 1}, FREE),
    ("rover", {"k_phi": 1}, FREE),
    ("rover", {"b_phi": 1}, FREE),
    ("rover", {"rad_per_us": 1}, 0.03),
    ("rover", {"h": 1}, 0.08),
    ("rover", {"ixx": 1}, 0.12),
    ("off", {"servo_lag": 1}, 0.4),
    ("off", {"delay": 1}, 0.4),
    ("off", {"trim": 1}, 2.0),
    ("off", {"gyro_lag": 1}, 1.0),
    ("off", {"accel_lag": 1}, 1.0),
    ("off", {"ekf_lag": 1}, 1.0),
    ("off", {"speed_scale": 1}, 0.01),
    ("off", {"ay_bias": 1}, FREE),
    ("off", {"heading_error": 1}, FREE),
)


def outputs(case: Case, noise_seed: int | None = None) -> list[Array]:
    """r, a_y, p, V_y of run1 to run3 over the wave, (4, n) each, at 100 Hz; noise only with a seed."""
    rough = QUIET if noise_seed is None else case.rough
    found = []
    for drive in case.plan[:3]:
        steering = steer(drive, stream(*case.seed, 10 + drive.number))
        rng = stream(*case.seed, 50 + drive.number + 10 * (noise_seed or 0))
        motion = move(case.rover, case.off, drive, steering, case.hidden, rough, rng)
        seen = measure(motion, case.rover, case.off, case.hidden, rough, case.filters, rng)
        c, s = np.cos(seen.psi), np.sin(seen.psi)
        vy = c * seen.velocity[:, 1] - s * seen.velocity[:, 0]
        first = drive.start + drive.straight + part(case.hidden, "clock_offset", "T", 0.0)
        lo, hi = round(first / STEP), round((first + 58.0) / STEP)
        found.append(np.stack([seen.gyro[:, 2], seen.accel[:, 1], seen.gyro[:, 0], vy])[:, lo:hi:10])
    return found


def _spectra(runs: list[Array]) -> list[NDArray[np.complex128]]:
    """Windowed transforms within BAND, (4, bins) a run."""
    out = []
    for x in runs:
        w = 2 * np.pi * np.fft.rfftfreq(x.shape[1], 10 * STEP)
        inside = (w >= BAND[0]) & (w <= BAND[1])
        tapered = (x - x.mean(axis=1, keepdims=True)) * np.hanning(x.shape[1]) * np.sqrt(8 / 3)
        out.append(np.fft.rfft(tapered, axis=1)[:, inside])
    return out


def whitener(case: Case, clean: list[Array]) -> Callable[[list[Array]], Array]:
    """Maps a difference of outputs to a real vector in which the noise of this rover has unit variance."""
    noise = [a - b for a, b in zip(outputs(case, 1), clean, strict=True)]
    smooth = np.ones(SMOOTHED) / SMOOTHED
    power = [np.array([np.convolve(np.abs(row) ** 2, smooth, "same") for row in z]) for z in _spectra(noise)]
    power = [p + 1e-3 * p.max(axis=1, keepdims=True) for p in power]

    def white(difference: list[Array]) -> Array:
        parts = [(z / np.sqrt(p / 2)).ravel() for z, p in zip(_spectra(difference), power, strict=True)]
        whole = np.concatenate(parts)
        return np.concatenate([whole.real, whole.imag])

    return white


def _moved(case: Case, where: str, fields: dict[str, float], share: float) -> Case:
    """The case with its `fields` moved by `share` of their values, with their signs."""
    values = {name: getattr(getattr(case, where), name) for name in fields}
    moved = {name: v + share * fields[name] * (v if abs(v) > 1e-3 else 2e-3) for name, v in values.items()}
    if where == "rover":
        return replace(case, rover=replace(case.rover, **moved))
    return replace(case, off=replace(case.off, **moved))


def imitations(case: Case, clean: list[Array], white: Callable[[list[Array]], Array]) -> Array:
    """Columns: what one standard deviation of each nuisance does, whitened."""
    columns = []
    for where, fields, spread in NUISANCES:
        shifted = outputs(_moved(case, where, fields, 0.03))
        columns.append(white([a - b for a, b in zip(shifted, clean, strict=True)]) / 0.03 * spread)
    return np.stack(columns, axis=1)


def concealed(case: Case, hidden: Hidden) -> Case:
    """The case with `hidden` in its motion, also what otherwise only the vehicle file hides."""
    x, z = part(hidden, "imu_offset", "x", 0.0), part(hidden, "imu_offset", "z", 0.0)
    rover = replace(case.rover, imu_x=case.rover.imu_x + x, imu_z=case.rover.imu_z + z)
    return replace(case, rover=rover, hidden=hidden)


def gain(change: Array, columns: Array) -> float:
    """Squared length of `change` off the `columns`, each of which has a unit normal prior."""
    keep = np.linalg.solve(np.eye(columns.shape[1]) + columns.T @ columns, columns.T @ change)
    return float(change @ (change - columns @ keep))


def gains(seed: int, number: int, factor: float, effects: tuple[str, ...]) -> dict[str, float]:
    """{effect: gain at `factor` times its size} of one rover."""
    case = draw_case(seed, number, "none")
    clean = outputs(case)
    white = whitener(case, clean)
    columns = imitations(case, clean, white)
    found = {}
    for effect in effects:
        drawn = draw_case(seed, number, "unknown" if effect in UNKNOWN else "single", factor, effect)
        change = white([a - b for a, b in zip(outputs(concealed(case, drawn.hidden)), clean, strict=True)])
        found[effect] = gain(change, columns)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.concealed.sizing")
    parser.add_argument("--rovers", type=int, default=6)
    parser.add_argument("--seed", type=int, default=900)
    parser.add_argument("--factor", type=float, default=1.0)
    args = parser.parse_args()
    effects = tuple(name for name in (*ids(), *UNKNOWN) if name not in ("tyre_slip", "roll_dof"))
    rows = [gains(args.seed, k + 1, args.factor, effects) for k in range(args.rovers)]
    print(f"gain at {args.factor:g} x the size: median (lowest, highest); to reach {GAIN:g}, size times")
    for effect in effects:
        values = np.array([row[effect] for row in rows])
        share = np.sqrt(GAIN / np.median(values))
        print(
            f"{effect:<24}{np.median(values):10.1f} ({values.min():.1f}, {values.max():.1f})  x {share:.2f}"
        )


if __name__ == "__main__":
    main()
