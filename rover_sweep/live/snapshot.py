"""The state of a rover at an instant, and the verdict on a run, as values for a screen."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import Literal

Advice = Literal["keep", "repeat", "discard"]


@dataclass(frozen=True)
class Snapshot:
    """The present state of the rover, about ten times a second. ISO axes: positive to the left. NaN: unknown.

    t: s, the vehicle's clock. armed, mode (custom_mode). pwm: steering output [us]; r, p [rad/s]; ay
    [m/s^2]; phi [rad]; speed [m/s]. state, state_name: of the applet; frequency: of the sweep [rad/s];
    progress: of the manoeuvre, 0..1. switch: PWM of the applet's channel [us]. battery: volts, and
    remaining 0..1. satellites, fix: GPS_FIX_TYPE. ekf: uses GPS. received: messages a second;
    recorded: bytes of the .tlog on disk. link: its fault as a sentence, '' if it is good.
    """

    t: float
    armed: bool = False
    mode: int = -1
    pwm: float = nan
    r: float = nan
    p: float = nan
    ay: float = nan
    phi: float = nan
    speed: float = nan
    state: int = 0
    state_name: str = ""
    frequency: float = nan
    progress: float = nan
    switch: float = nan
    volts: float = nan
    remaining: float = nan
    satellites: int = 0
    fix: int = 0
    ekf: bool = False
    received: float = nan
    recorded: int = 0
    link: str = ""


@dataclass(frozen=True)
class CoherenceBand:
    """Coherence of one response in a band [rad/s]: the median in it, and the verdict in a word or two."""

    response: str
    low: float
    high: float
    coherence: float
    words: str


@dataclass(frozen=True)
class ResponseCurve:
    """The response of one quantity to the steering, to draw it.

    Equally long: w [rad/s], gain [dB of the quantity's SI unit over the steering's], phase [deg], coherence.
    steering: "rad" of the road wheels (left is positive), as in the reports; "us" of the servo output (in
    ArduPilot a larger one turns right) where the vehicle file has no rad_per_us.
    """

    response: str
    w: tuple[float, ...]
    gain: tuple[float, ...]
    phase: tuple[float, ...]
    coherence: tuple[float, ...]
    steering: str = "us"


@dataclass(frozen=True)
class Verdict:
    """The verdict on a run. sentence: what to do and why, in plain words; amplitude: proposed for the
    next one [us], None where this one's will do. per_band: amplitudes proposed band by band,
    (low, high [rad/s], us). source: the recording that was judged. curves: what was measured, to draw it.
    throttle: (that of the run, the lower one proposed) [us], None where it was not too high."""

    run: str
    advice: Advice
    sentence: str
    bands: tuple[CoherenceBand, ...] = ()
    amplitude: float | None = None
    per_band: tuple[tuple[float, float, float], ...] = ()
    source: Path | None = None
    remarks: tuple[str, ...] = ()
    curves: tuple[ResponseCurve, ...] = ()
    throttle: tuple[int, int] | None = None
