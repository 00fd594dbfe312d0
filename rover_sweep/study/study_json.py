"""study.json: every number of the study and the published ones."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from rover_sweep.identification.fit import FitResult
from rover_sweep.identification.handling import handling, has_handling
from rover_sweep.report.wording.provenance import versions
from rover_sweep.study import published
from rover_sweep.study.conditions import CHECKS
from rover_sweep.study.findings import StudyFinding
from rover_sweep.study.published import MODELS
from rover_sweep.study.virtual_study import Practice, Study


def study_document(study: Study, found: tuple[StudyFinding, ...]) -> dict[str, Any]:
    """The study in plain types: findings, published numbers, the rover, and each way of fitting."""
    return {
        "format": "rover-sweep study 1",
        "paper": published.PAPER,
        "seed": study.seed,
        "versions": versions(),
        "findings": {f.key: {"claim": f.claim, "outcome": f.outcome, "text": f.text} for f in found},
        "published": _published(),
        "rover": {"asphalt": asdict(study.runs.asphalt), "grass": asdict(study.runs.grass)},
        "firmware": asdict(study.runs.firmware),
        "speed_m_s": study.paper.group.speed,
        "coherent_bands_rad_s": dict(study.coherent),
        "practices": {key: _practice(p) for key, p in study.practices.items()},
        "counterfactuals": {
            "roll_yaw_frozen_at_identified_speed_tic": study.counterfactuals.frozen.tic,
            "roll_yaw_cf_cr_free_tic": {k: v.tic for k, v in study.counterfactuals.untied.items()},
            "roll_yaw_gyro_filter_ignored_tau_s": study.counterfactuals.gyro_ignored["tau"].value,
            "roll_yaw_velocity_lag_known_izz_kg_m2": study.counterfactuals.prompt["Izz"].value,
            "lumped_as_table_4_average": study.counterfactuals.as_table_4.average,
        },
    }


def _published() -> dict[str, Any]:
    return {
        "parameters": {
            m: {n: asdict(p) for n, p in rows.items()} for m, rows in published.PARAMETERS.items()
        },
        "cost": {m: dict(row) for m, row in published.COSTS.items()},
        "verification": {
            c: {m: asdict(v) for m, v in row.items()} for c, row in published.VERIFICATION.items()
        },
        "bands_rad_s": dict(published.BANDS),
    }


def _practice(practice: Practice) -> dict[str, Any]:
    return {
        "title": practice.title,
        "words": practice.words,
        "models": {m: _model(practice, m) for m in MODELS},
    }


def _model(practice: Practice, model: str) -> dict[str, Any]:
    fit, costs = practice.fit(model), practice.result.models[model].costs
    return {
        "parameters": {
            e.name: {
                "value": e.value,
                "unit": e.unit,
                "free": e.free,
                "cr_percent": e.cr_percent,
                "insensitivity_percent": e.insensitivity_percent,
            }
            for e in fit.estimates
        },
        "cost": {**costs, "average": fit.average, "fitted": list(fit.costs)},
        "verification": {c: _verification(practice, model, c) for c in CHECKS},
        "critical_speed_m_s": _critical_speed(fit),
    }


def _critical_speed(fit: FitResult) -> float | None:
    return handling(fit).get("critical_speed") if has_handling(fit.structure) else None


def _verification(practice: Practice, model: str, check: str) -> dict[str, Any]:
    v = practice.check(model, check)
    channels = {o.channel: {"j_rms": o.j_rms, "tic": o.tic, "unit": o.unit} for o in v.overlays}
    return {"speed_m_s": v.speed, "j_rms": v.j_rms, "tic": v.tic, "channels": channels}
