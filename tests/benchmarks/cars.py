"""Real cars that nobody drove for this tool: what it makes of each, or why it refuses.

    python tests/benchmarks/cars.py [FOLDER]

FOLDER holds the CSV files (default: $ROVER_SWEEP_RECORDINGS/cars); column maps and what is assumed of the
vehicles stand in tests/data/cars. Every car is one row a group of runs at one speed, and one row a model.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import rover_sweep as rs
from rover_sweep.data.results import ShortTable, band_words, plain_number

MAPS = Path(__file__).parents[1] / "data" / "cars"
DEFAULT = Path(__file__).parents[3] / "shared" / "recordings"


def identified(path: Path) -> rs.Result:
    """The bicycle, roll-yaw and lumped models of one CSV, as far as its vehicle file goes."""
    vehicle = MAPS / f"{path.stem}.vehicle.toml"
    runs = rs.read(
        path, vehicle=vehicle if vehicle.is_file() else None, columns=MAPS / f"{path.stem}.columns.toml"
    )
    return rs.identify(runs)


def main(folder: Path) -> None:
    bands, models, words = [], [], []
    for path in sorted(folder.glob("*.csv")):
        start = time.perf_counter()
        try:
            result = identified(path)
        except rs.RoverSweepError as refusal:
            words.append(f"{path.stem}: refused (exit code {refusal.exit_code}): {refusal}")
            continue
        seconds = time.perf_counter() - start
        for group in result.groups:
            found = (group.responses.get(o) for o in ("r", "ay", "vydot", "p"))
            shown = (band_words(f.band) if f else "not recorded" for f in found)
            bands.append((path.stem, str(len(group.runs)), f"{group.speed:.2f}", *shown))
        for name, m in result.models.items():
            free = ", ".join(f"{e.name} {plain_number(e.value, 3)}" for e in m.fit.estimates if e.free)
            shown = free if m.verdict.level != "not identifiable" else "-"
            models.append((path.stem, name, f"{m.fit.average:.1f}", m.verdict.level, shown))
        models += [(path.stem, name, "-", "refused", "-") for name in result.refused]
        words += [f"{path.stem}: {why}" for why in dict.fromkeys(result.refused.values())]
        keep = sum(v.keep for v in result.coherence)
        words += [
            f"{path.stem}: {keep} of {len(result.coherence)} runs to keep, {seconds:.1f} s in all; {sentence}"
            for sentence in result.summary[:1]
        ]
    headings = ("car", "runs", "m/s", "r", "ay", "vydot", "p")
    print(ShortTable("usable bands, rad/s", headings, tuple(bands)))
    print(ShortTable("models", ("car", "model", "J_ave", "verdict", "parameters"), tuple(models)))
    print(*words, sep="\n")


if __name__ == "__main__":
    given = sys.argv[1:2] or [os.environ.get("ROVER_SWEEP_RECORDINGS", str(DEFAULT)) + "/cars"]
    main(Path(given[0]))
