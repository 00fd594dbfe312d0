"""The two P1 recordings as .csv, which `rover-sweep diagnose` and `rs.read` take; units stay as recorded.

python tests/acceptance/p1_tables.py FOLDER_OF_MAT FOLDER_OF_CSV
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat

NAMES = ("time", "delta", "r", "p", "ay", "beta")
STARTS = 14.0  # s, until which the car of the second file is at standstill


def tables(source: Path, target: Path) -> tuple[Path, Path]:
    """Writes (p1_sweep.csv, p1_verify.csv); the second from where the car starts, its beta empty."""
    files = ("P1_Final_Sweep.mat", "P1_Final_Verify.mat")
    out = (target / "p1_sweep.csv", target / "p1_verify.csv")
    for name, path in zip(files, out, strict=True):
        file = loadmat(source / name)
        t = file["time"].ravel()
        columns = [file[n].ravel() if n in file else np.full(t.size, np.nan) for n in NAMES]
        rows = np.column_stack(columns)[t >= STARTS]  # the sweep begins at 35 s
        np.savetxt(path, rows, "%.9g", ",", header=",".join(NAMES), comments="")
    return out


if __name__ == "__main__":
    print(*tables(Path(sys.argv[1]), Path(sys.argv[2])), sep="\n")
