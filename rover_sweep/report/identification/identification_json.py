"""identification.json: the whole result for programs. Its keys are the contract of `rover-sweep identify`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from rover_sweep.data.recording import OUTPUTS, STEERING_CHANNELS, Recording
from rover_sweep.data.results import LEVEL, Quantity
from rover_sweep.data.vehicle_rules import LARGEST_OF_STEERING
from rover_sweep.identification.both_ways import BothWays
from rover_sweep.identification.fit import Estimate, FitResult
from rover_sweep.identification.grouping import Group
from rover_sweep.identification.model_results import TIED
from rover_sweep.identification.pipeline import Identification, inertia_of, judged_runs, ordered, rejection
from rover_sweep.identification.verify import Verification
from rover_sweep.quality.verdict import CoherenceVerdict
from rover_sweep.report.identification.sentences import handling_document
from rover_sweep.report.wording import Provenance, plain
from rover_sweep.spectra.response import FrequencyResponse

# One model of identification.json: parameters, costs, verification, poles, variants, reduction.


def model_document(result: Identification, name: str) -> dict[str, Any]:
    """Parameters, cost, verification and all else of a model; see `identification_document`.

    If the kinematic model suffices, the value of every free parameter of a larger model is null, with
    "reason", and "rejected" has the optimiser's numbers.
    """
    model, reason = result.models[name], rejection(result, name)
    more, some = {}, next((e for e in model.fit.estimates if e.interval_90), None)
    # C of the fit with one C for both axles is no parameter of this fit; kept for programs that read C
    if tied := model.variants.get(TIED):
        more["C"] = {**parameters_document(tied, reason)["C"], "variant": TIED}
    return {
        "verdict": {"level": model.verdict.level, "sentences": model.verdict.sentences},
        "reference": model.fit.structure.reference,
        "speed_m_s": model.fit.speed,
        "parameters": parameters_document(model.fit, reason) | more,
        "bootstrap": {"level": LEVEL, "replicates": some.replicates, "failed": some.failed} if some else None,
        "cost": _cost(model.costs, model.fit.costs),
        "verification": _verification(model.verification[0]) if model.verification else None,
        "verification_runs": [_verification(v) for v in model.verification],
        "poles": _poles(model.fit),
        "starts_spread_percent": 100 * model.fit.spread,
        "variants": {
            label: {"parameters": parameters_document(f, reason), "cost": _cost(f.costs, f.costs)}
            for label, f in model.variants.items()
        },
        "reduction": [
            {
                "parameter": s.parameter,
                "reason": s.reason,
                "average_before": s.before,
                "average_after": s.after,
                "dropped": s.dropped,
                "unstable_without": s.unstable,
                "found": s.found,
                "fixed_at": s.value if s.dropped else None,
            }
            for s in model.reduction
        ],
    }


def parameters_document(fit: FitResult, reason: str | None = None) -> dict[str, Any]:
    """{name: {value, unit, free, cr_percent, insensitivity_percent, interval_90, sd, ..., meaning}}.

    interval_90 [low, high], sd and bias by the bootstrap, in the parameter's unit; null without one.
    """
    return {e.name: _parameter(e, reason if e.free else None) for e in fit.estimates}


def _parameter(e: Estimate, reason: str | None) -> dict[str, Any]:
    numbers = {
        "value": e.value,
        "cr_percent": e.cr_percent,
        "insensitivity_percent": e.insensitivity_percent,
        "interval_90": list(e.interval_90) if e.interval_90 else None,
        "sd": e.sd,
        "bias": e.bias,
    }
    shown: dict[str, Any] = dict.fromkeys(numbers) if reason else numbers
    own = {"unit": e.unit, "free": e.free, "at_bound": e.at_bound, "meaning": e.meaning}
    return shown | own | ({"reason": reason, "rejected": numbers} if reason else {})


def _cost(costs: Mapping[str, float], fitted: Mapping[str, float]) -> dict[str, Any]:
    return {
        **{output: costs.get(output) for output in OUTPUTS},
        **{label: j for label, j in costs.items() if label not in OUTPUTS},
        "average": float(np.mean(list(fitted.values()))),
        "fitted": list(fitted),
        "average_all": float(np.mean(list(costs.values()))),
    }


def _verification(v: Verification) -> dict[str, Any]:
    return {
        "j_rms": v.j_rms,
        "tic": v.tic,
        "run": v.run,
        "speed_m_s": v.speed,
        "channels": {o.channel: {"unit": o.unit, "j_rms": o.j_rms, "tic": o.tic} for o in v.overlays},
        "state_biases": v.state_biases,
        "output_biases": v.output_biases,
    }


def _poles(fit: FitResult) -> list[dict[str, float]]:
    """Poles [rad/s] with natural frequency [rad/s] and damping ratio, slowest first."""
    poles = sorted(fit.structure.poles(fit.speed), key=lambda s: (abs(s), s.imag))
    return [
        {
            "re": float(s.real),
            "im": float(s.imag),
            "frequency_rad_s": float(abs(s)),
            "damping": float(-s.real / abs(s)) if s else 0.0,
        }
        for s in poles
    ]


FORMAT_VERSION = 1
AXES = (
    "ISO 8855: x forward, y left, z up; a left turn has positive r, a_y and steering angle, "
    "an outward roll positive phi"
)
UNITS = "SI, rad, rad/s; J in dB and deg; J_rms in deg/s and ft/s^2"


def identification_document(result: Identification, provenance: Provenance) -> dict[str, Any]:
    """The whole result in plain JSON types, SI units unless a key or a "unit" says otherwise.

    models.<name>: see `model_document`. runs[].coherence.<output> = {band [rad/s], covered, lowest,
    lowest_at_rad_s}. Numbers that are not finite are null. Keys keep their order.
    """
    return plain(
        {
            "format": "rover-sweep identification",
            "format_version": FORMAT_VERSION,
            "recommended": result.recommended,
            "summary": result.summary,
            "speed_m_s": result.speed,
            "numbers": {e.name: number_document(e) for e in result.numbers},
            "residual_over_noise": result.residual,
            "stiffness_by_amplitude": [asdict(one) for one in result.by_amplitude],
            "forward_and_reverse": [_both_ways(pair) for pair in result.both_ways],
            "models": {name: model_document(result, name) for name in ordered(result)},
            "refused": result.refused,
            "inertia": inertia_document(result, provenance),
            "handling": handling_document(result, provenance.verify_runs),
            "runs": [recording_document(r) | (_verdict(v) if v else {}) for r, v in judged_runs(result)],
            "verification_recordings": [recording_document(run) for run in provenance.verify_runs],
            "groups": [_group(group) for group in result.groups],
            "vehicle": _vehicle(result, provenance),
            "settings": asdict(result.settings),
            "conventions": {"axes": AXES, "units": UNITS},
            "versions": provenance.versions,
            "command": provenance.command or None,
            "made": provenance.made or None,
        }
    )


def number_document(e: Quantity) -> dict[str, Any]:
    """{value, unit, interval_90, meaning} of a number of the rover."""
    return {"value": e.value, "unit": e.unit, "interval_90": e.interval_90, "meaning": e.meaning}


def _both_ways(pair: BothWays) -> dict[str, Any]:
    ways = {"forward": pair.forward, "reverse": pair.reverse}
    found = {way: {"value": q.value, "interval_90": q.interval_90} for way, q in ways.items()}
    of = pair.forward
    return {"name": of.name, "unit": of.unit, "meaning": of.meaning, **found, "differs": pair.differs}


def inertia_document(result: Identification, provenance: Provenance) -> dict[str, Any]:
    """The yaw inertia of the vehicle file and of each model, with the difference in percent."""
    stated = provenance.vehicle.yaw_inertia if provenance.vehicle else None
    value = stated.value if stated else result.geometry.yaw_inertia
    models = {}
    for name, model in ordered(result).items():
        found = inertia_of(model)
        if found and rejection(result, name) is None:
            percent = 100 * (found.value / value - 1) if value else None
            models[name] = {"value": found.value, "difference_percent": percent}
    return {
        "unit": "kg m^2",
        "vehicle_file": {"value": value, "sd": stated.sd if stated else None},
        "models": models,
    }


def _vehicle(result: Identification, provenance: Provenance) -> dict[str, Any]:
    vehicle, source = provenance.vehicle, provenance.vehicle_source
    steering = None
    if vehicle and vehicle.trim_us and vehicle.rad_per_us:
        steering = {"trim_us": vehicle.trim_us.value, "rad_per_us": asdict(vehicle.rad_per_us)}
        measured = {name: getattr(vehicle, name) for name in LARGEST_OF_STEERING}  # by `bench`
        steering |= {name: asdict(number) for name, number in measured.items() if number is not None}
    return {
        "name": vehicle.name if vehicle else "",
        "file": source[0] if source else None,
        "sha256": source[1] if source else None,
        "geometry": asdict(result.geometry),
        "steering": steering,
    }


def _verdict(verdict: CoherenceVerdict) -> dict[str, Any]:
    return {
        "verdict": verdict.advice,
        "sentence": verdict.sentence,
        "excited_rad_s": verdict.range,
        "amplitude": verdict.amplitude,
        "amplitude_unit": verdict.amplitude_unit,
        "next_amplitude": verdict.next.amplitude,
        "coherence": {
            o.output: {
                "band": o.band,
                "covered": o.covered,
                "lowest": o.lowest,
                "lowest_at_rad_s": o.lowest_at,
            }
            for o in verdict.outputs
        },
    }


def recording_document(run: Recording) -> dict[str, Any]:
    """Source files, channels, filters and notes of a recording."""
    return {
        "name": run.name,
        "kind": run.kind,
        "speed_m_s": run.mean_speed if "speed" in run else None,
        "span_s": run.span,
        "firmware": run.firmware,
        "sources": [{"file": name, "sha256": digest} for name, digest in run.sources],
        "channels": {
            name: {"source": s.source, "unit": s.unit, "rate_hz": run.manoeuvre(name).rate}
            | ({"origin": s.origin} if name in STEERING_CHANNELS else {})
            for name, s in run.channels.items()
        },
        "filters": {
            name: {"cutoff_hz": f.cutoff_hz, "order": 2, "source": f.source}
            for name, f in run.filters.items()
        },
        "notes": [
            {"level": note.level, "text": note.text} | ({"fault": note.fault} if note.fault else {})
            for note in run.notes
        ],
    }


def _group(group: Group) -> dict[str, Any]:
    return {
        "speed_m_s": group.speed,
        "runs": [run.name for run in group.runs],
        "responses": {name: _response(f) for name, f in group.responses.items()},
        "responses_to_other_inputs": {
            name: {output: _response(f) for output, f in found.items()}
            for name, found in group.others.items()
        },
    }


def _response(f: FrequencyResponse) -> dict[str, Any]:
    conditioning = {}
    if f.multiple_coherence is not None and f.input_coherence is not None:  # "coherence" is then partial
        conditioning = {
            "conditioned_on": f.conditioned_on,
            "multiple_coherence": _rounded(f.multiple_coherence),
            "input_coherence": _rounded(f.input_coherence),
        }
    return {
        "unit": f.unit,
        "band": f.band,
        "windows_s": f.windows,
        "w_rad_s": _rounded(f.w),
        "magnitude_db": _rounded(f.magnitude_db),
        "phase_deg": _rounded(f.phase_deg),
        "coherence": _rounded(f.coherence),
        **conditioning,
        "random_error": _rounded(f.random_error),
    }


def _rounded(x: Sequence[float] | np.ndarray) -> list[float]:
    return [float(f"{value:.6g}") for value in x]
