"""Keep, repeat or discard a run, and the sentence that says why: the first fault that counts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.live.snapshot import Advice
from rover_sweep.live.verdict.bands import per_rad
from rover_sweep.quality.coherence import CoherenceVerdict, judged_responses, sign_is_wrong
from rover_sweep.quality.faults import advice_on
from rover_sweep.spectra.amplitude import AmplitudeProposal
from rover_sweep.spectra.response import COHERENCE_GOOD, FrequencyResponse

NO_ANSWER = 0.3  # median coherence of the yaw rate below which it does not follow the steering
CURVING = 0.3  # mean yaw rate over its standard deviation above which a run is not straight
UNSTEADY = 0.25  # standard deviation of the speed over its mean
# How notes on a recording begin if its run must be repeated (from `logs.completeness` and `logs.judge`).
NOT_WHOLE = (
    "The recording ends before",
    "The recording has a hole",
    "The recording begins after",
    "The applet stopped this run",
    "Steering is at its end stop",
)

Responses = Mapping[str, FrequencyResponse]
Said = tuple[Advice, str]


def advice(
    run: Recording,
    found: Responses,
    measured: CoherenceVerdict,
    proposal: AmplitudeProposal,
    vehicle: Vehicle | None,
) -> Said:
    """What to do with a sweep or multisine, and why."""
    if broken := advice_on(run):
        return broken
    for fault in (*_of_mounting(run, found, vehicle), *_of_driving(run)):
        return fault
    unit = measured.amplitude_unit
    if not measured.keep:
        return "repeat", _repeat(judged_responses(found), measured, proposal)
    better = "" if proposal.amplitude is None else f"; better with {_us(proposal.amplitude, unit)} {unit}"
    return "keep", measured.sentence + better


def _of_mounting(run: Recording, found: Responses, vehicle: Vehicle | None) -> Iterator[Said]:
    """Faults that no other amplitude removes."""
    r = found["r"]
    if np.median(r.coherence) < NO_ANSWER:
        yield (
            "discard",
            "discard: the yaw rate does not follow the steering output (coherence "
            f"{np.median(r.coherence):.2f}): do the front wheels move, and is it the right output?",
        )
        return
    if "ay" in found and _low_end(r, found["ay"]) < 0:
        yield (
            "discard",
            "discard: a_y and the yaw rate point to opposite sides: the autopilot is not mounted as "
            "AHRS_ORIENTATION says, or the rover drove backwards",
        )
    scale = vehicle.rad_per_us.value if vehicle and vehicle.rad_per_us else None
    if scale is not None and sign_is_wrong(per_rad(r, scale)):
        yield (
            "discard",
            "discard: the rover yaws to the opposite side of the steering: rad_per_us of the vehicle file "
            "has the wrong sign, or the autopilot is not mounted as AHRS_ORIENTATION says",
        )


def _low_end(r: FrequencyResponse, ay: FrequencyResponse) -> float:
    """Cross product of both answers in the lower half of the range: V |r|^2, positive, for any rover."""
    low = r.w <= np.sqrt(r.w[0] * r.w[-1])
    return float(np.sum((r.h.conj() * ay.h * r.coherence * ay.coherence)[low]).real)


def side_remark(found: Responses) -> Iterator[str]:
    """A remark if the linkage is reversed, so that rad_per_us of the vehicle file must be negative."""
    r = found["r"]
    if r.input == "pwm" and not sign_is_wrong(r):
        yield "a larger PWM turns this rover left: rad_per_us of its vehicle file is negative"


def _of_driving(run: Recording) -> Iterator[Said]:
    """Faults that a repeat removes."""
    for note in run.notes:
        if note.text.startswith(NOT_WHOLE):
            yield "repeat", f"repeat: {note.text[0].lower()}{note.text[1:]}"
    r, speed = run.manoeuvre("r").x, run.manoeuvre("speed").x
    mean = float(np.mean(r)) - (run.bias("r") or 0.0)
    if run.kind != "bias_sweep" and abs(mean) > CURVING * float(np.std(r)):
        side = "left" if mean > 0 else "right"
        yield (
            "repeat",
            f"repeat, and drive straighter: the rover turns {side} on average, by "
            f"{abs(np.degrees(mean)):.0f} deg/s; trim the steering or take more room",
        )
    if np.std(speed) > UNSTEADY * abs(np.mean(speed)):
        low, high = np.percentile(speed, (5, 95))
        yield "repeat", f"repeat at a steady speed: it went from {low:.1f} to {high:.1f} m/s"


def _repeat(judged: Responses, measured: CoherenceVerdict, proposal: AmplitudeProposal) -> str:
    """The sentence to repeat with more amplitude, or with a lower w_max if no more is possible."""
    poor = min((o for o in measured.outputs if o.output in judged), key=lambda o: o.covered)
    unit = measured.amplitude_unit
    why = (
        f"coherence of {poor.output} is below {COHERENCE_GOOD:g} over {100 * (1 - poor.covered):.0f} % of "
        f"the range (down to {poor.lowest:.2f} at {poor.lowest_at:.2g} rad/s)"
    )
    lower = f"lower w_max to {proposal.w_max:.2g} rad/s" if proposal.w_max else ""
    if proposal.amplitude is not None:
        more = f"repeat with {_us(proposal.amplitude, unit)} {unit} in place of {_us(proposal.driven, unit)}"
        capped = f"; {proposal.sentence}" if any(band.cap for band in proposal.bands) else ""
        return f"{more}{f' and {lower}' if lower else ''}: {why}{capped}"
    if lower:
        return f"repeat, and {lower}: {why}; {proposal.sentence}"
    if any(band.cap for band in proposal.bands):
        return f"repeat faster or with a longer T_rec: {why}; {proposal.sentence}"
    return f"repeat at a steady speed and straighter: {why}, though the amplitude is enough"


def _us(amplitude: float, unit: str) -> str:
    return f"{amplitude:.0f}" if unit == "us" else f"{amplitude:.2g}"
