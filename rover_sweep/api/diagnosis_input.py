"""The inputs of a diagnosis from the user's arguments, and the call itself with remarks on the data."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

from rover_sweep.api.known_steering import has_linkage, known
from rover_sweep.api.read import doublets_apart, refuse_overlap, refuse_without_sweep
from rover_sweep.api.save import result_document
from rover_sweep.data.recording import Recording, origin_remark, steering_of
from rover_sweep.data.results import Progress
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.data.vehicle_geometry import geometry_of, tolerances_of
from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.result import BASELINES, START, Baseline, Diagnosis, DiagnosisSettings
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.identification.grouping import Settings, grouped
from rover_sweep.identification.model_results import determined_model
from rover_sweep.identification.pipeline import wrong_place_in
from rover_sweep.quality.faults import OPTIONAL, faulty_channels, with_length, without_faulty
from rover_sweep.quality.rovers import with_rovers
from rover_sweep.report.diagnosis.diagnosis_json import DiagnosisOrigin
from rover_sweep.report.wording import Provenance

NOTHING_HELD_OUT = (
    "no run was held out, so the result is not tested on other data: drive a doublet or one more sweep, "
    "and give it with --hold-out"
)
MORE_COMPLETE: Mapping[str, Baseline] = {"tyre_slip": "bicycle", "roll_dof": "roll-yaw"}  # with the effect
Stop = Callable[[], bool]


@dataclass(frozen=True, eq=False)
class Material:
    """The recordings by their roles: used for fit and selection, held out, made by a simulation."""

    runs: tuple[Recording, ...]
    held_out: tuple[Recording, ...] = ()
    simulated: tuple[Recording, ...] = ()

    def origin(self, provenance: Provenance, settings: DiagnosisSettings) -> DiagnosisOrigin:
        """The recordings with their roles, and the settings, for the report."""
        parts = (
            *(("fit", run) for run in self.runs),
            *(("held out", run) for run in self.held_out),
            *(("simulation", run) for run in self.simulated),
        )
        return DiagnosisOrigin(provenance, parts, asdict(settings))  # type: ignore[arg-type]


def material(
    runs: Sequence[Recording], held_out: Sequence[Recording], simulated: Sequence[Recording] = ()
) -> Material:
    """The runs by their roles; if none is held out, the doublets are, provided that other runs remain.

    UsageError where one run has two roles.
    """
    others, doublets = doublets_apart(runs)
    fitted, kept = (tuple(runs), tuple(held_out)) if held_out or not others else (others, doublets)
    refuse_overlap(fitted, kept)
    for run in simulated:
        digests = {digest for _, digest in run.sources}  # of its files, whatever their names
        if any(digests & {digest for _, digest in other.sources} for other in (*fitted, *kept)):
            raise UsageError(f"{run.name} is both the recording and the simulation; simulate it first")
    return Material(fitted, kept, tuple(simulated))


def diagnosed(
    given: Material,
    vehicle: Vehicle,
    settings: DiagnosisSettings,
    progress: Progress | None = None,
    stop: Stop | None = None,
) -> Diagnosis:
    """The diagnosis with remarks on the data and on how it ended.

    Data that the diagnosis refuses give the verdict "refused" with the reason, not an exception.
    """
    from rover_sweep.diagnosis.diagnose import diagnose

    started = time.monotonic()
    bench = known(vehicle, tolerances_of(vehicle))
    settled = {effect: why for effect, why in bench.settled.items() if effect not in settings.with_effects}
    settings = replace(settings, spread=bench.spread, without_effects=(*settings.without_effects, *settled))
    left_out: tuple[str, ...] = ()
    misplaced = simpler = ""
    try:
        given, left_out = _sound(given)
        rover, groups = geometry_of(vehicle), grouped(given.runs, Settings())
        own = settings.baseline is not None or bool(given.simulated)
        if not own:
            baseline, why = determined_model(groups, rover)
            candidates_left(settings.with_effects, settings.without_effects, baseline)
            settings = replace(settings, baseline=baseline)
            simpler = f"the baseline is the {baseline} model: {why}" if why else ""
        misplaced = wrong_place_in(groups, rover, settings.baseline or "")
        others = given.held_out, given.simulated, progress, stop, groups
        found = diagnose(given.runs, rover, settings, *others)
        # What the coherence of one channel did not show, sideslip or roll, all channels together may.
        while not own and (more := [f.effect for f in found.findings if f.effect in MORE_COMPLETE]):
            limit = settings.time_limit
            left = None if limit is None else limit - (time.monotonic() - started)
            if left is not None and left <= 0:
                break
            settings, simpler = replace(settings, baseline=MORE_COMPLETE[more[0]]), ""
            found = diagnose(given.runs, rover, replace(settings, time_limit=left), *others)
    except DataRefused as error:
        found = Diagnosis(
            "refused",
            str(error),
            settings.baseline or "roll-yaw",
            seconds=time.monotonic() - started,
            runs=tuple(run.name for run in given.runs),
            held_out_runs=tuple(run.name for run in given.held_out),
        )
    behind = any(run["delta"].origin == "measured" for run in given.runs if "delta" in run)
    if found.model is not None and not behind and None not in (vehicle.trim_us, vehicle.rad_per_us):
        found = replace(found, model=replace(found.model, steering=vehicle.steering()))
    remarks = [NOTHING_HELD_OUT] if not given.held_out and found.verdict != "refused" else []
    remarks += [*filter(None, (origin_remark(steering_of(given.runs)), simpler, misplaced)), *left_out]
    remarks += [f"{effect} was not looked for: {why}" for effect, why in settled.items()]
    if has_linkage(vehicle):
        remarks.append(
            "the steering was corrected by the bench measurement ([steering] in the vehicle file); a "
            "simulation from this report does not include that correction"
        )
    if stop is not None and stop():
        seconds = time.monotonic() - started
        remarks.append(f"stopped by hand after {seconds:.0f} s, so only the results so far are reported")
    return replace(found, remarks=(*found.remarks, *remarks), seconds=time.monotonic() - started)


def why_not_diagnosed(runs: Sequence[Recording], held_out: Sequence[Recording]) -> str:
    """Why these runs would be refused for a diagnosis, such as runs of two rovers; "" if they would not."""
    try:
        _sound(material(runs, held_out))
    except (DataRefused, UsageError) as refused:
        return str(refused)
    return ""


def _sound(given: Material) -> tuple[Material, tuple[str, ...]]:
    """The material without faulty runs and lateral channels, and why; DataRefused where more is faulty.

    Runs in reverse are left out, except where there are no others.
    """
    refuse_without_sweep(given.runs)
    ahead, checks_ahead = (tuple(r for r in s if r.mean_speed >= 0) for s in (given.runs, given.held_out))
    back = [r.name for r in (*given.runs, *given.held_out) if r.mean_speed < 0] if ahead else []
    if back:
        given = replace(given, runs=ahead, held_out=checks_ahead)
    sound, checks, apart = without_faulty(given.runs, given.held_out, ())
    given = replace(given, runs=sound, held_out=checks)
    runs = with_rovers((*with_length(given.runs), *given.held_out))
    without, why = faulty_channels(runs)
    apart = (*apart, *((f"left out {', '.join(back)}: driven in reverse",) if back else ()))
    if not without:
        return given, apart
    left = {c for run in runs for c in run.channels} - without
    if without - set(OPTIONAL) or not left & set(OPTIONAL):
        raise DataRefused("; ".join(why))
    fitted, kept = (tuple(r.without(without) for r in some) for some in (given.runs, given.held_out))
    out = replace(given, runs=fitted, held_out=kept)
    return out, (*apart, *(f"left out: {words}" for words in why))


def effects_named(names: Sequence[str]) -> tuple[str, ...]:
    """The ids, each once; UsageError for an id that the library does not have."""
    from difflib import get_close_matches

    for name in names:
        if name not in library():
            near = get_close_matches(name, library(), 1)
            hint = f"did you mean {near[0]}? There are" if near else "there are"
            raise UsageError(f"there is no effect {name!r}; {hint} {', '.join(library())}")
    return tuple(dict.fromkeys(names))


def candidates_left(
    only: Sequence[str], without: Sequence[str], baseline: Baseline | None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """(with_effects, without_effects) of the settings; UsageError where no candidate would be left.

    baseline: None where a simulation or the runs will determine it.
    """
    chosen, left_out = effects_named(only), effects_named(without)
    left = set(chosen or library()) - set(left_out)
    if not left:
        raise UsageError("no candidate is left to try; name fewer effects in --without")
    if baseline and not any(baseline in library()[effect].baselines for effect in left):
        kept = ", ".join(e for e in library() if e in left)
        raise UsageError(
            f"no candidate is left to try: none of {kept} can be missing from the {baseline} baseline; "
            "name other effects in --only, or use another --baseline"
        )
    return chosen, left_out


def time_limit_of(seconds: float | None) -> float | None:
    """The limit [s], None for no limit; UsageError for a value that is not a positive number."""
    if seconds is None:
        return None
    if isinstance(seconds, bool) or not isinstance(seconds, int | float):
        raise UsageError(f"the time limit is {seconds!r}; give seconds, or leave it out for no limit")
    if not (isfinite(seconds) and seconds > 0):
        raise UsageError(
            f"the time limit is {seconds:g} s; give a time above 0, or leave it out for no limit"
        )
    return float(seconds)


def nominal_of(path: Path, baseline: str | None) -> tuple[Baseline, Mapping[str, float]]:
    """(baseline, {parameter: SI value}) of an identification.json, or of one of its models/*.json.

    baseline: which of its models, None for the recommended one. UsageError for any other file, and for a
    model that is missing or whose parameters were rejected.
    """
    document = result_document(path)
    if document.get("format") not in ("rover-sweep identification", "rover-sweep model"):
        raise UsageError(f"{path} is not an identification.json; give the file that `identify` wrote")
    if document.get("format") == "rover-sweep model":
        name, values = document.get("model"), document.get("parameters", {})
    else:
        name = baseline or document.get("recommended")
        models = _object(document.get("models", {}), path, "models")
        if not isinstance(name, str) or name not in models:
            raise UsageError(f"{path} has no model {name!r}; it has {', '.join(map(str, models)) or 'none'}")
        given = _object(_object(models[name], path, name).get("parameters"), path, f"parameters of {name}")
        entries = {p: _object(v, path, f"{p} of {name}") for p, v in given.items()}
        values = {p: v.get("value") for p, v in entries.items() if "variant" not in v}
    known: dict[str, Baseline] = {b: b for b in BASELINES}
    if name not in known or baseline not in (None, name):
        raise UsageError(f"{path} holds the model {name!r}; give one of {', '.join(BASELINES)}")
    values = _object(values, path, f"parameters of {name}")
    if lacking := [p for p, v in values.items() if v is None]:
        raise UsageError(
            f"{path}: {lacking[0]} of its {name} model could not be identified; use another model"
        )
    for p, v in values.items():
        number = isinstance(v, int | float) and not isinstance(v, bool) and isfinite(v)
        if not number or (p in START and v <= 0):
            wrong = f"{v:g}; it must be above 0" if number else f"{v!r}, which is no number"
            raise UsageError(f"{path}: {p} of its {name} model is {wrong}; run identify again")
    if name in ("roll-yaw", "bicycle") and not values.keys() & set(START):
        raise UsageError(
            f"{path}: its {name} model has none of {', '.join(START)}; give the file that `identify` wrote"
        )
    return known[name], {p: float(v) for p, v in values.items()}


def _object(part: Any, path: Path, where: str) -> dict[str, Any]:
    """The JSON object `where` of the file; UsageError if it is anything else."""
    if isinstance(part, dict):
        return part
    raise UsageError(
        f"{path} cannot be read as a model: {where} is {part!r}, not an object; run identify again"
    )
