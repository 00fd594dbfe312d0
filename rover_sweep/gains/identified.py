"""Input of the gains from an identification or a diagnosis: model, uncertainty, valid speeds and band."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.plausibility import implausible
from rover_sweep.data.recording import AT_LOOP, LowPass
from rover_sweep.data.results import NORMAL_90
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.diagnosis.linear import hidden_filters, left_out, linear
from rover_sweep.diagnosis.result import Diagnosis
from rover_sweep.gains.servo import origin_of, servo_doubts, servo_of
from rover_sweep.identification.model_results import UNTIED
from rover_sweep.identification.models import bicycle, kinematic, roll_yaw
from rover_sweep.identification.state_space import ModelStructure
from rover_sweep.identification.verdicts import CR_LIMIT, I_LIMIT, J_RMS_GUIDE, TIC_GUIDE

# Autopilot loop during the runs, from the runs of an identification.json.


SLOWEST_LOOP, FASTEST_LOOP = 20.0, 400.0  # Hz, of ArduRover's main loop


def loop_wait(run: Mapping[str, Any]) -> float:
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


# Why a model may not set gains: it was not tested on a held-out run, or its numbers are implausible.


IDENTIFIED = ("C", "Cf", "Cr", "Izz", "Ixx", "h", "k_phi")


def not_predicted(held_out: Iterable[tuple[str, float, float]]) -> tuple[str, ...]:
    """Sentences on a missing or failed prediction. held_out: (run, J_rms [deg/s and ft/s^2], TIC) of each."""
    tested = tuple(held_out)
    if not tested:
        return (
            "no run was held out, so it is unknown whether the model predicts another run: drive a doublet "
            "or one more sweep, and give it to identify with --verify or to diagnose with --hold-out",
        )
    return tuple(
        f"the model does not predict {run}, which was held out: J_rms {j_rms:.3g} (at most {J_RMS_GUIDE:g}), "
        f"TIC {tic:.2f} (at most {TIC_GUIDE:g})"
        for run, j_rms, tic in tested
        if not (j_rms <= J_RMS_GUIDE and tic <= TIC_GUIDE)
    )


def absurd(rover: Geometry, found: Mapping[str, float]) -> tuple[str, ...]:
    """Sentences on implausible numbers of a model. found: {parameter: SI value}, named as in the models.

    Of a kinematic model only the effective wheelbase is judged, as a steering scale.
    """
    scale = found.get("gain", 1.0) * rover.wheelbase / found.get("L_eff", rover.wheelbase)
    own = {n: found[n] for n in IDENTIFIED if n in found and "L_eff" not in found}
    return implausible(rover, {**own, "steering_scale": scale})


PHYSICAL = ("roll-yaw", "bicycle", "kinematic")  # models valid at speeds other than that of the runs
WHOLE = ("none", "explained")  # verdicts of a diagnosis whose model lacks nothing that matters
GUESSED_DELAY, GUESSED_GAIN = 0.3, 0.15  # relative half-widths, if no interval is known


@dataclass(frozen=True, eq=False)
class Identified:
    """A model from road-wheel angle [rad] to yaw rate [rad/s], with its uncertainty and quality.

    name, level: the model and its verdict. intervals: 90 % intervals {parameter: (low, high)}. speeds: of
    the runs [m/s]. band: usable band of the response of r [rad/s], None without one. rad_per_us: of the
    vehicle file. gyro_hz: low-pass of the gyro in the runs; loop_hz: main loop in the runs; both None if
    unknown. amplitude_us, largest_us: smallest and largest PWM amplitude of the runs. hidden: additional
    low-passes found by a diagnosis. remarks: sentences on effects not in the model. reasons: why there is no
    model. doubts: why the model may set no gains, though it may be a good fit. has_servo: whether the servo
    is in the structure, which then begins at the command.
    """

    name: str
    level: str
    structure: ModelStructure | None
    intervals: Mapping[str, tuple[float, float]]
    speeds: tuple[float, ...]
    band: tuple[float, float] | None = None
    rad_per_us: float | None = None
    gyro_hz: float | None = None
    loop_hz: float | None = None
    amplitude_us: float | None = None
    largest_us: float | None = None
    hidden: tuple[LowPass, ...] = ()
    remarks: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    has_servo: bool = True

    @property
    def kinematic(self) -> bool:
        return self.name.startswith("kinematic")

    def spread(self) -> Iterator[tuple[str, ModelStructure]]:
        """(label, structure) of the model and of every corner of its parameters' intervals.

        Cf and Cr change together, because their sum is much less certain than their ratio.
        """
        structure = self.structure
        assert structure is not None
        yield "as identified", structure
        axles = tuple(n for n in ("Cf", "Cr") if n in self.intervals)
        groups = [g for g in (axles, *((n,) for n in self.intervals if n not in axles)) if g]
        for corner in itertools.product((0, 1), repeat=len(groups)):
            ends = [(n, end) for group, end in zip(groups, corner, strict=True) for n in group]
            values = {n: self.intervals[n][end] for n, end in ends}
            label = ", ".join(f"{n} {v:.3g}" for n, v in values.items())
            yield label, structure.with_values(_tied(structure, values))


def from_identification(
    document: Mapping[str, Any], wanted: str | None = None, vehicle: Vehicle | None = None
) -> Identified:
    """From the document of identification.json. wanted: one of PHYSICAL, None for the recommended one.

    vehicle: replaces rad_per_us and the servo of the document. UsageError where it has no rad_per_us. Raises
    KeyError, TypeError or ValueError for an invalid document.
    """
    models = document["models"]
    name = wanted or document["recommended"]
    forward = [g for g in document["groups"] if g["speed_m_s"] > 0]
    speeds = tuple(abs(float(g["speed_m_s"])) for g in forward or document["groups"])
    if not forward:
        back = ("all runs were driven in reverse: gains need a sweep forward",)
        return Identified(name or "no", "refused", None, {}, speeds, reasons=back)
    if name not in PHYSICAL or name not in models:
        reasons = (*document["summary"], *(f"{m}: {why}" for m, why in document["refused"].items()))
        if name in models:
            reasons = (f"the recommended {name} model is valid at the speed of the runs only", *reasons)
        return Identified(name or "no", "refused", None, {}, speeds, reasons=reasons)
    model, steering = models[name], document["vehicle"]["steering"]
    parameters = _best_parameters(model)
    lost = [n for n, p in parameters.items() if p["value"] is None]
    geometry = _geometry(document["vehicle"]["geometry"])
    structure = None if lost else _structure(name, geometry, parameters)
    run = document["runs"][0]
    bands = [g["responses"]["r"]["band"] for g in forward if "r" in g["responses"]]
    usable = [b for b in bands if b]
    wait = loop_wait(run)
    servo, origin = servo_of(vehicle, steering), origin_of(document)
    structure, intervals = _with_shorter_delay(structure, wait), _intervals(parameters, wait)
    added = servo if origin == "measured" else None
    if added:
        structure, intervals = added.before(structure, intervals)
    own = float(steering["rad_per_us"]["value"]) if steering else None
    return Identified(
        name,
        model["verdict"]["level"],
        structure,
        intervals,
        speeds,
        (max(b[0] for b in usable), min(b[1] for b in usable)) if usable else None,
        vehicle.steering()[1] if vehicle else own,
        cutoff(run),
        loop(run),
        amplitude(document["runs"]),
        widest_amplitude(document["runs"]),
        (),
        (*(added.remarks if added else ()), *play_remark(steering)),
        tuple(model["verdict"]["sentences"]),
        (*_doubts(model, geometry, parameters), *servo_doubts(origin, servo, _steering_of(document))),
        origin == "commanded" or added is not None,
    )


def _steering_of(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Sources of the steering in the runs of an identification.json."""
    sources = (run["channels"].get("delta", {}).get("source", "") for run in document["runs"])
    return tuple(str(source) for source in sources if source)


def _doubts(model: Mapping[str, Any], geometry: Geometry, parameters: Mapping[str, Any]) -> tuple[str, ...]:
    """Why a model of an identification.json may set no gains."""
    tested = [(str(v["run"]), float(v["j_rms"]), float(v["tic"])) for v in model["verification_runs"]]
    free = {n: float(p["value"]) for n, p in parameters.items() if p["free"] and p["value"] is not None}
    return (*not_predicted(tested), *absurd(geometry, free))


def from_diagnosis(found: Diagnosis, vehicle: Vehicle | None = None) -> Identified:
    """From the linearised model of a diagnosis, with assumed intervals of gain and delay.

    vehicle: its rad_per_us and servo; of a measured steering, the diagnosis has neither.

    The baseline must be valid at other speeds: ValueError for the lumped one, and without a model.
    """
    model = found.model
    if model is None:
        raise ValueError(f"this diagnosis holds no model: {found.sentence}")
    if model.lumped:
        raise ValueError(
            "a diagnosis of the lumped model is valid at one speed only, so no gains can be computed"
        )
    hidden = tuple(f for c, f in hidden_filters(model).items() if c == "r")
    known = model.filters.get("r")
    lost = tuple(f"not included in the computed loop: {words}" for words in left_out(model))
    structure = _with_shorter_delay(linear(model), model.wait)
    assert structure is not None
    intervals = _assumed_intervals(structure)
    servo, origin = servo_of(vehicle, None), model.steering_origin
    added = servo if origin == "measured" else None
    if added:
        with_servo, intervals = added.before(structure, intervals)
        assert with_servo is not None
    else:
        with_servo = structure
    tested = ((h.run, h.after.j_rms, h.after.tic) for h in found.held_out)
    return Identified(
        model.name,
        "good" if found.verdict in WHOLE else "poor",
        with_servo,
        intervals,
        (model.speed,),
        rad_per_us=vehicle.steering()[1] if vehicle else model.steering[1] if model.steering else None,
        gyro_hz=known.cutoff_hz if known else None,
        hidden=hidden,
        remarks=(*(added.remarks if added else ()), *lost),
        reasons=(f"the diagnosis says {found.verdict.upper()}, so its model lacks a part of the motion",),
        doubts=(*not_predicted(tested), *absurd(model.rover, structure.values), *servo_doubts(origin, servo)),
        has_servo=origin == "commanded" or added is not None,
    )


def _best_parameters(model: Mapping[str, Any]) -> dict[str, Any]:
    """The model's parameters, with free Cf and Cr if that fits better and is identifiable.

    With one C for both axles the position of the CG alone determines the understeer, and so the steady turn
    rate that FF depends on. The relative intervals are those of the fit with one C.
    """
    tied = {n: p for n, p in model["parameters"].items() if "variant" not in p}
    free = model["variants"].get(UNTIED)
    if free is None or not free["cost"]["average"] < model["cost"]["average"]:
        return dict(tied)
    own = dict(free["parameters"])
    if any(p["value"] is None or _not_identifiable(n, p) for n, p in own.items() if p["free"]):
        return dict(tied)
    for name, p in own.items():
        known = tied.get(name) or tied["C"]
        ends, value = known["interval_90"], known["value"]
        if ends is not None:
            own[name] = {**p, "interval_90": [p["value"] * end / value for end in ends]}
        elif p["free"]:
            own[name] = {**p, "cr_percent": known["cr_percent"]}
    return own


def _not_identifiable(name: str, p: Mapping[str, Any]) -> bool:
    uncertain = (p["cr_percent"] or 0.0) > CR_LIMIT or (p["insensitivity_percent"] or 0.0) > I_LIMIT
    return name != "tau" and bool(p["at_bound"] or uncertain)


def _geometry(known: Mapping[str, Any]) -> Geometry:
    return Geometry(**{f.name: known[f.name] for f in fields(Geometry) if f.name in known})


def _structure(name: str, geometry: Geometry, parameters: Mapping[str, Any]) -> ModelStructure:
    tied = "C" in parameters
    made = {
        "roll-yaw": lambda: roll_yaw(geometry, tied),
        "bicycle": lambda: bicycle(geometry, tied),
        "kinematic": lambda: kinematic(geometry),
    }[name]()
    found = made.with_values({n: float(p["value"]) for n, p in parameters.items()})
    for p in found.free:
        upper = 10.0 if p.name == "tau" else p.upper  # s; a long delay has its own answer: no gains
        if not p.lower <= p.value <= upper:
            raise ValueError(f"{p.name} is {p.value:g} {p.unit}, outside {p.lower:g} to {upper:g}")
    return found


def _intervals(parameters: Mapping[str, Any], wait: float) -> dict[str, tuple[float, float]]:
    """The 90 % interval of every free parameter: from the bootstrap, else from the Cramer-Rao bound.

    wait [s]: subtracted from the interval of the delay.
    """
    out = {}
    for name, p in parameters.items():
        value, bounds, cr = p["value"], p["interval_90"], p["cr_percent"]
        if not p["free"] or value is None:
            continue
        if bounds is not None and bounds[0] is not None and not float(bounds[0]) <= float(bounds[1]):
            raise ValueError(f"the 90 % interval of {name} is {bounds[0]:g} to {bounds[1]:g}")
        if bounds is not None and all(isinstance(b, int | float) and math.isfinite(b) for b in bounds):
            low, high = min(bounds[0], value), max(bounds[1], value)
        else:
            half = min(NORMAL_90 * (cr or 0.0) / 100, 0.9) * abs(value)
            low, high = value - half, value + half
        out[name] = (max(low - wait, 0.0), max(high - wait, 0.0)) if name == "tau" else (low, high)
    return out


def _assumed_intervals(structure: ModelStructure) -> dict[str, tuple[float, float]]:
    """Assumed intervals if no accuracy is known: steering gain +-15 %, delay +-30 %."""
    shares = {"gain": GUESSED_GAIN, "tau": GUESSED_DELAY}
    known = {n: structure.values[n] for n in shares if structure.values.get(n, 0.0) > 0}
    return {n: (value * (1 - shares[n]), value * (1 + shares[n])) for n, value in known.items()}


def _tied(structure: ModelStructure, values: Mapping[str, float]) -> dict[str, float]:
    follow = {
        p.name: p.tied[1] * values[p.tied[0]] for p in structure.parameters if p.tied and p.tied[0] in values
    }
    return {**values, **follow}


def _with_shorter_delay(structure: ModelStructure | None, wait: float) -> ModelStructure | None:
    """The structure with a delay that is shorter by `wait` [s]."""
    if structure is None or "tau" not in structure.values:
        return structure
    return structure.with_values({"tau": max(structure.values["tau"] - wait, 0.0)})
