"""The verdict on a run within a second of its end: keep it, repeat it, or discard it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.design.advice import WEAK_AMPLITUDE
from rover_sweep.errors import DataRefused, RoverSweepError
from rover_sweep.live.snapshot import Verdict
from rover_sweep.live.verdict.bands import coherence_bands, response_curves, spoken
from rover_sweep.live.verdict.keep_or_repeat import advice, side_remark
from rover_sweep.live.verdict.limits import limits_of, limits_of_wheels
from rover_sweep.logs.log import Log
from rover_sweep.logs.read import read_logs, runs_of
from rover_sweep.quality.coherence import assess, judged_responses, responses
from rover_sweep.quality.faults import advice_on
from rover_sweep.quality.length import each_with_length
from rover_sweep.spectra.amplitude import AmplitudeProposal, propose_amplitude
from rover_sweep.spectra.response import FrequencyResponse

Span = tuple[float, float]


def judge(tlog: Path, span: Span, name: str, vehicle: Vehicle | None = None) -> Verdict:
    """The verdict on the run within `span` [s of the vehicle's clock] of a recording, .tlog or .BIN.

    vehicle: its file, for the friction and the sign of the steering. Never raises for bad data: the verdict
    names their fault.
    """
    try:
        logs = read_logs(str(tlog))
    except RoverSweepError as error:
        said = f"this recording cannot be judged: {error}"
        return Verdict(name, "repeat", f"{said}; the vehicle's log may still be good", source=tlog)
    refusal = (
        f"no run was found between {span[0]:.0f} and {span[1]:.0f} s: was the rover steered and driving?"
    )
    for log in reversed(logs):
        try:
            runs = [run for run in runs_of(log) if run.span[0] < span[1] and run.span[1] > span[0]]
        except DataRefused as error:
            refusal = str(error)
            continue
        if runs:
            return renamed(verdict_on_log(runs[-1], log, vehicle), name, tlog)
    return Verdict(name, "discard", f"discard: {refusal}", source=tlog)


def renamed(verdict: Verdict, name: str, source: Path) -> Verdict:
    """The verdict under the run's name, with the recording that was judged."""
    return replace(verdict, run=name, source=source)


def verdict_on_log(run: Recording, log: Log, vehicle: Vehicle | None = None) -> Verdict:
    """The verdict on a run of a log."""
    (run,) = each_with_length([run])
    remarks = tuple(note.text for note in run.notes if note.level == "warning")
    if run.kind == "doublet" and (broken := advice_on(run)):
        return Verdict(run.name, *broken, remarks=remarks)
    if run.kind == "doublet":
        said = "keep: a doublet, for verification; its coherence is not judged"
        return Verdict(run.name, "keep", said, remarks=remarks)
    input = "delta" if "delta" in run else "pwm"
    try:
        found = responses([run], input=input)
    except ValueError as error:  # too short for a single window
        return Verdict(run.name, "discard", f"discard: the run is too short ({error})", remarks=remarks)
    measured = assess(run, found)
    proposal = proposed(run, found, log.parameters, vehicle)
    word, sentence = advice(run, found, measured, proposal, vehicle)
    by_band = coherence_bands(found)
    return Verdict(
        run.name,
        word,
        sentence,
        by_band,
        proposal.amplitude if word != "discard" else None,
        tuple((b.low, b.high, b.amplitude) for b in proposal.bands),
        remarks=(
            *(f"{response}: {words}" for response, words in spoken(by_band).items()),
            *((f"amplitude: {proposal.sentence}",) if proposal.sentence else ()),
            *(side_remark(found) if vehicle is None else ()),
            *remarks,
        ),
        curves=response_curves(found, vehicle.rad_per_us.value if vehicle and vehicle.rad_per_us else None),
    )


def proposed(
    run: Recording,
    found: Mapping[str, FrequencyResponse],
    parameters: Mapping[str, float],
    vehicle: Vehicle | None = None,
    servo_60_deg: float | None = None,
) -> AmplitudeProposal:
    """The amplitude for the next run like this one [us; rad for a .csv that has the wheels' angle]."""
    judged = judged_responses(found)
    if "pwm" not in run:
        unit = run["delta"].unit or "rad"
        driven = _amplitude(run, "delta")
        limits = limits_of_wheels(judged, run.mean_speed, driven, vehicle)
        return propose_amplitude(judged, driven, limits, unit=unit)
    driven = _amplitude(run, "pwm")
    scale = _amplitude(run, next(iter(found.values())).input) / driven
    middle = _middle(run) if run.kind == "bias_sweep" else 0.0
    limits = limits_of(judged, run.mean_speed, parameters, scale, middle, vehicle, servo_60_deg)
    return propose_amplitude(judged, driven, limits, WEAK_AMPLITUDE)


def _amplitude(run: Recording, channel: str) -> float:
    return float(np.ptp(run.manoeuvre(channel).x)) / 2


def _middle(run: Recording) -> float:
    x = run.manoeuvre("pwm").x
    return float((x.max() + x.min()) / 2 - x[0])
