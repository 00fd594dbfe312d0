"""Autopilot loop during the runs, from the runs of an identification.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rover_sweep.data.recording import AT_LOOP

SLOWEST_LOOP, FASTEST_LOOP = 20.0, 400.0  # Hz, of ArduRover's main loop


def wait(run: Mapping[str, Any]) -> float:
    """Mean wait [s] of the recorded command for the main loop; the controller's output has no such wait.

    The applet logs its command when it sets it; the servo gets it in the next main loop, half a period
    later on average (`AP_MotorsUGV::output` calls the one push a loop). 0 if the log reader stamped the
    command at the main loop, or if it was logged when sent (SERVO_OUTPUT_RAW, RCOU).
    """
    main = loop(run)
    source = run["channels"].get("delta", {}).get("source", "")
    waited = source.startswith("SWEP") and not source.endswith(AT_LOOP)
    return 0.5 / main if main and waited else 0.0


def loop(run: Mapping[str, Any]) -> float | None:
    """Main loop rate [Hz] from the IMU, which is logged once per loop; None if unknown."""
    rate = run["channels"].get("r", {}).get("rate_hz")
    return round(float(rate)) * 1.0 if rate and SLOWEST_LOOP <= rate <= FASTEST_LOOP * 1.02 else None


def cutoff(run: Mapping[str, Any]) -> float | None:
    """Low-pass of the gyro [Hz], None if unknown."""
    known = run["filters"].get("r")
    return float(known["cutoff_hz"]) if known else None


def play_remark(steering: Mapping[str, Any] | None) -> tuple[str, ...]:
    """A remark if play was measured on blocks, and so is corrected in the runs and not in the model."""
    half_gap = (steering or {}).get("backlash", {}).get("value", 0.0)
    if not half_gap:
        return ()
    words = (
        f"the steering's play ({half_gap:.3g} rad to each side) is not included in this loop: smaller "
        "corrections act late or not at all"
    )
    return (words,)


def widest_amplitude(runs: Sequence[Mapping[str, Any]]) -> float | None:
    """The largest PWM amplitude [us] of the runs, from their coherence verdicts; None if unknown."""
    return max(_amplitudes(runs), default=None)


def _amplitudes(runs: Sequence[Mapping[str, Any]]) -> list[float]:
    return [float(r["amplitude"]) for r in runs if r.get("amplitude") and r.get("amplitude_unit") == "us"]


def amplitude(runs: Sequence[Mapping[str, Any]]) -> float | None:
    """The smallest PWM amplitude [us] of the runs, from their coherence verdicts; None if unknown."""
    found = _amplitudes(runs)
    return float(min(found)) if found else None
