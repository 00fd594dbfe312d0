"""Origin of a diagnosis: recordings, settings, provenance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from rover_sweep.data.recording import Recording
from rover_sweep.report.wording.provenance import Provenance

Role = Literal["fit", "held out", "simulation"]


@dataclass(frozen=True, eq=False)
class DiagnosisOrigin:
    """Recordings with their roles, settings and provenance of a diagnosis."""

    provenance: Provenance = field(default_factory=Provenance)
    recordings: tuple[tuple[Role, Recording], ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
