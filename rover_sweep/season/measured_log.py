"""One log of a season: when, on which board, with which parameters, and its fit or why there is none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rover_sweep.season.fitted_log import FittedLog

TEXTS = (
    "source",
    "sha256",
    "day",
    "day_from",
    "board",
    "system",
    "firmware",
    "vehicle",
    "vehicle_file",
    "refused",
)
FORMAT = 1  # of the saved values; another one is measured again


@dataclass(frozen=True, eq=False)
class MeasuredLog:
    """The values of one log.

    source: path or URL as given. sha256: of its contents. day: ISO date (UTC), "" if not known; day_from:
    "GPS", "telemetry", "file name" or "file time". board: name and id of the autopilot's board, "" if not
    logged. system: MAVLink id, "" if not known. vehicle: its name, where a vehicle file is named after it,
    else "". vehicle_file: name of the file whose numbers were used.
    refused: the sentence of a log that cannot be used, "" for one that was fitted.
    """

    source: str
    sha256: str = ""
    day: str = ""
    day_from: str = ""
    board: str = ""
    system: str = ""
    firmware: str = ""
    vehicle: str = ""
    vehicle_file: str = ""
    parameters: Mapping[str, float] = field(default_factory=dict)
    fit: FittedLog | None = None
    refused: str = ""


def as_document(log: MeasuredLog) -> dict[str, Any]:
    """The log in plain JSON types; `from_document` restores every number exactly."""
    fit = log.fit
    return {
        "format": "rover-sweep measured log",
        "format_version": FORMAT,
        "source": log.source,
        "sha256": log.sha256,
        "day": log.day,
        "day_from": log.day_from,
        "board": log.board,
        "system": log.system,
        "firmware": log.firmware,
        "vehicle": log.vehicle,
        "vehicle_file": log.vehicle_file,
        "parameters": dict(log.parameters),
        "refused": log.refused,
        "fit": None
        if fit is None
        else {
            "names": list(fit.names),
            "values": fit.values.tolist(),
            "information": fit.information.tolist(),
            "linear": fit.linear.tolist(),
            "variance": fit.variance,
            "runs": list(fit.runs),
        },
    }


def from_document(document: Mapping[str, Any]) -> MeasuredLog:
    """The log of `as_document`; KeyError, TypeError or ValueError for anything else."""
    if document["format_version"] != FORMAT:
        raise ValueError(f"format {document['format_version']} instead of {FORMAT}")
    fit = document["fit"]
    texts = {key: str(document[key]) for key in TEXTS}
    return MeasuredLog(
        **texts,
        parameters={str(k): float(v) for k, v in document["parameters"].items()},
        fit=None
        if fit is None
        else FittedLog(
            tuple(fit["names"]),
            np.array(fit["values"], float),
            np.array(fit["information"], float),
            np.array(fit["linear"], float),
            float(fit["variance"]),
            tuple(fit["runs"]),
        ),
    )
