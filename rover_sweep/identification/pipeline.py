"""From runs to models: responses, fits, faults of the data, verification, verdicts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import combinations
from math import isfinite

import numpy as np
from threadpoolctl import threadpool_limits

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.plausibility import implausible
from rover_sweep.data.recording import OUTPUTS, LowPass, Recording
from rover_sweep.data.results import ByName, PlainNumbers, Quantity, ShortTable, Shown, band_words, number
from rover_sweep.data.vehicle_file import MODELS, Vehicle
from rover_sweep.identification.bootstrap import with_intervals
from rover_sweep.identification.both_ways import BothWays, both_ways, ways_compared
from rover_sweep.identification.fit import (
    Condition,
    Estimate,
    FitResult,
    costs,
    drawn_starts,
    fit,
    has_zero_response,
)
from rover_sweep.identification.grouping import Group, Settings, grouped
from rover_sweep.identification.handling import Handling, gain_error, handling, has_handling
from rover_sweep.identification.model_results import (
    PHYSICAL,
    TIED,
    UNTIED,
    ModelResult,
    NotPossible,
    RunStiffness,
    Work,
    fitted_result,
    model_result,
    physical_result,
    recommendation,
    stiffness_by_amplitude,
    tyres_not_identifiable,
    wrong_wheelbase,
)
from rover_sweep.identification.models import kinematic, refitted_with_lag
from rover_sweep.identification.state_space import ModelStructure
from rover_sweep.quality.coherence import input_responses
from rover_sweep.quality.faults import (
    doubts,
    each_with_length,
    fault_sentences,
    too_short,
    with_length,
    without_faulty,
)
from rover_sweep.quality.rovers import TWO_ROVERS, with_rovers
from rover_sweep.quality.verdict import CoherenceTable, CoherenceVerdict, assess
from rover_sweep.spectra.response import moving

# A user's own structure, fitted to the runs like the built-in models.


def own_result(structure: ModelStructure, work: Work) -> ModelResult:
    """The fit of a structure over all speeds to the fitted responses that it has, verified and judged.

    Raises NotPossible with the reason when the runs do not allow it.
    """
    for name in structure.inputs[1:]:
        if any(name not in g.others for g in work.groups):
            raise NotPossible(
                f"{structure.name} has the input {name}, but the responses are not conditioned on it: add "
                f"--condition-on {name} and use runs in which it was recorded and moves"
            )
    if unknown := [o for o in structure.outputs if o not in OUTPUTS]:
        raise NotPossible(
            f"{structure.name} has the output {unknown[0]!r}; outputs can be {', '.join(OUTPUTS)}"
        )
    if not structure.free:
        raise NotPossible(f"{structure.name} has no free parameter, so there is nothing to identify")
    outputs = [o for o in structure.outputs if o in work.settings.fitted]
    conditions = work.conditions(outputs or structure.outputs)
    if not all(c.data for c in conditions):
        raise NotPossible(
            f"{structure.name} cannot be identified: none of its outputs ({', '.join(structure.outputs)}) "
            "has a usable band in the fitted responses"
        )
    if not _has_finite_responses(structure, conditions):
        raise NotPossible(
            f"{structure.name} has no finite nonzero response at {work.groups[0].speed:.2f} m/s: change its "
            "starting values"
        )
    starts = [
        s for s in drawn_starts(structure) if _has_finite_responses(structure.with_values(s), conditions)
    ]
    best = fit(structure, conditions, starts)
    variants = {}
    if any(g.runs[0].filters for g in work.groups):
        bare = work.conditions(outputs or structure.outputs, filtered=False)
        variants["filters ignored"] = fit(best.structure, bare)
    return fitted_result(best, variants, work)


def _has_finite_responses(structure: ModelStructure, conditions: Sequence[Condition]) -> bool:
    """True when every response of the structure is finite and nonzero."""
    try:
        with np.errstate(all="ignore"):
            whole = list(costs(structure, conditions).values())
            return bool(np.all(np.isfinite(whole))) and not has_zero_response(structure, conditions)
    except (ArithmeticError, np.linalg.LinAlgError):
        return False


# Detects a wrong sign in the IMU's position of the vehicle file: the reversed position gives a better model.
#
# a_y is measured at the IMU: a_y of the CG + x r' - z p', so only a_y depends on x and z. A wrong x changes
# the identified tyre stiffness and yaw inertia instead of the fit: 5 cm with the wrong sign gave C = 78
# instead of 32 N/rad at J_ave = 6. The cost alone does not show it, but the yaw inertia does: it was 2.5
# times too large.


MIN_DISTANCE = 0.02  # m from the CG: the effect of a smaller one is too small
NOISE = 2.0  # J_ave of a perfect model with noise
MAX_RISE = 1.25  # of J_ave, up to which a better yaw inertia still decides
INERTIA = 1.5  # weight of ln(yaw inertia) against ln(J_ave)
THRESHOLD = 0.65  # of the score; the largest of 26 correct cases (IMU at +-3, 5, 8 cm) is .55
INERTIA_RATIO = 0.75  # yaw inertia over m a b when the vehicle file has none; rovers have .56 to .9


def wrong_place(found: FitResult, conditions: Sequence[Condition], geometry: Geometry) -> str:
    """A sentence on what to correct in imu.position of the vehicle file, '' if the signs are plausible."""
    tried = [
        (names, fit(found.structure.with_values(reversed_values), conditions))
        for names, reversed_values in _reversed_signs(found, geometry)
    ]
    scores = [(_score(found, other, geometry), names, other) for names, other in tried]
    score, names, best = max(scores, key=lambda t: t[0], default=(0.0, (), found))
    return _sentence(found, best, names, geometry) if score > THRESHOLD else ""


def wrong_place_in(found: Sequence[Group], geometry: Geometry, model: str) -> str:
    """As `wrong_place`, from groups; '' when the model has no IMU position or cannot be identified."""
    groups = tuple(g for g in found if not g.why_not())
    if model not in PHYSICAL or not groups:
        return ""
    work = Work(groups, geometry, (), Settings(models=(model,)))
    try:
        return wrong_place(model_result(model, work).fit, work.conditions(), geometry)
    except NotPossible:
        return ""


def _score(found: FitResult, other: FitResult, geometry: Geometry) -> float:
    """Score of the reversed position: decrease of ln J_ave plus that of the yaw inertia's log error."""
    if other.average > MAX_RISE * found.average:
        return -np.inf
    errors = [abs(float(np.log(f["Izz"].value / _inertia(geometry)))) for f in (found, other)]
    return float(
        np.log((found.average + NOISE) / (other.average + NOISE)) + INERTIA * (errors[0] - errors[1])
    )


def _inertia(geometry: Geometry) -> float:
    """Expected yaw inertia [kg m^2]: that of the vehicle file, or typical for this mass and these axles."""
    return geometry.yaw_inertia or INERTIA_RATIO * geometry.mass * geometry.a * geometry.b


def _sentence(found: FitResult, best: FitResult, names: tuple[str, ...], geometry: Geometry) -> str:
    axes = " and ".join(names)
    change = "falls" if best.average < found.average else "hardly rises"
    source = "the vehicle file says" if geometry.yaw_inertia else "mass and axles suggest"
    return (
        f"the IMU's position has the wrong sign: with {axes} of imu.position reversed, J_ave {change} "
        f"from {found.average:.1f} to {best.average:.1f}, and the yaw inertia {best['Izz'].value:.3g}, not "
        f"{found['Izz'].value:.3g} kg m^2 ({source} {_inertia(geometry):.3g}); check the sign of "
        f"{axes} in the vehicle file"
    )


def _reversed_signs(
    found: FitResult, geometry: Geometry
) -> Iterator[tuple[tuple[str, ...], dict[str, float]]]:
    """(axes whose sign is reversed, parameter values with these signs) for each combination to try."""
    known = {p.name for p in found.structure.parameters if not p.free}
    h = geometry.h or 0.0
    values = {
        "forward": {"imu_x": -geometry.imu_x},
        "down": {"imu_z": 2 * h - geometry.imu_z},  # the file counts from the sprung CG
    }
    far = {"forward": abs(geometry.imu_x) > MIN_DISTANCE, "down": abs(geometry.imu_z - h) > MIN_DISTANCE}
    usable = [n for n, change in values.items() if far[n] and set(change) <= known]
    for names in (c for size in (1, 2) for c in combinations(usable, size)):
        yield names, {k: x for n in names for k, x in values[n].items()}


OF_FILE = ("roll-yaw", "bicycle", "lumped")  # models that depend on masses, inertias and the IMU's position


@dataclass(frozen=True, eq=False, repr=False)
class Identification(PlainNumbers, Shown):
    """The result of an identification. recommended: name of the model to use; summary: reasons, as sentences.

    coherence: a verdict for each run. refused: {model that could not be identified: reason}. `models` always
    has the kinematic model, which shows whether the data contain any effect of the tyres. numbers: the
    rover's, allowing for errors of the vehicle file and normal tolerances, if requested and a model with
    tyres fits; those of `models` are from a fit of the responses alone, as in CIFER. by_amplitude: the tyres
    of the recommended model, from each run alone. both_ways: its parameters and the steering forward and in
    reverse, where both were driven. residual {channel: mean square of the residual of `numbers`' model over
    that of the noise}: about 1 where only noise is left.
    """

    geometry: Geometry
    settings: Settings
    groups: tuple[Group, ...]
    coherence: tuple[CoherenceVerdict, ...]
    models: Mapping[str, ModelResult]
    refused: Mapping[str, str]
    recommended: str | None
    summary: tuple[str, ...]
    numbers: ByName[Quantity] = field(default_factory=ByName)
    by_amplitude: tuple[RunStiffness, ...] = ()
    both_ways: tuple[BothWays, ...] = ()
    residual: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "coherence", CoherenceTable(self.coherence))

    @property
    def speed(self) -> float:
        """Speed of the first group, m/s."""
        return self.groups[0].speed

    @cached_property
    def handling(self) -> dict[str, Handling]:
        """{model: handling quantities} of the identified models with tyres.

        Also of the fits with one stiffness for each axle, "<model>, Cf and Cr free", and, where that is the
        model itself, "<model>, one C for both axles". Fits with both axles free are refitted with a lag of
        the steering: with a delay alone, the gain that a servo loses lowers Cf. The modes are those of the
        model itself (matrix A); their intervals include those of the refit.
        """
        fits = {
            f"{name}{label}": fit
            for name, m in self.models.items()
            if m.verdict.level != "not identifiable" and has_handling(m.fit.structure)
            for label, fit in (("", m.fit), *((f", {v}", m.variants.get(v)) for v in (UNTIED, TIED)))
            if fit is not None
        }
        error = gain_error(_runs(self.groups))
        conditions = [g.condition(self.settings.fitted) for g in self.groups]
        lagged = {
            id(fit): refitted_with_lag(fit, conditions)
            for fit in fits.values()
            if "Cf" in fit.structure.values
        }
        found = {
            name: handling(lagged.get(id(fit), fit), None, error, self.models[name.partition(",")[0]].fit)
            for name, fit in fits.items()
        }
        if "K_us" in self.numbers:
            known = self.numbers["K_us"], self.geometry.wheelbase
            for name in {f"{self.recommended}, {UNTIED}", self.recommended or ""} & found.keys():
                found[name] = found[name].with_understeer(*known)
        return found

    def table(self) -> ShortTable:
        """A row for each model; usable bands, refused models, the recommendation."""
        rows = []
        for name, m in self.models.items():
            v = next(iter(m.verification), None)
            checked = (f"{v.j_rms:.2f}", f"{v.tic:.3f}") if v else ("-", "-")
            rows.append((name, m.verdict.level, f"{m.fit.average:.1f}", *checked))
        bands = (
            f"at {g.speed:.2f} m/s, usable bands in rad/s: "
            + ", ".join(f"{o} {band_words(f.band)}" for o, f in g.responses.items())
            for g in self.groups
        )
        refused = (f"{name} refused: {why}" for name, why in self.refused.items())
        runs = sum(len(g.runs) for g in self.groups)
        told = ", ".join(f"{q.name} {number(q.value, 3)} {q.unit}" for q in self.numbers)
        return ShortTable(
            f"identification from {runs} run{'s' if runs != 1 else ''}",
            ("model", "verdict", "J_ave", "J_rms", "TIC"),
            tuple(rows),
            (*bands, *refused, *self.summary, *([f"the rover's numbers: {told}"] if told else [])),
        )


@threadpool_limits.wrap(limits=1, user_api="blas")  # small matrices: threads cost more than they bring
def identify(
    runs: Sequence[Recording],
    geometry: Geometry,
    verify_on: Sequence[Recording] = (),
    settings: Settings | None = None,
    structures: Sequence[ModelStructure] = (),
    fitted: Callable[[Mapping[str, ModelResult]], None] | None = None,
    vehicle: Vehicle | None = None,
) -> Identification:
    """Identifies models from runs that have `delta`, and verifies them on the runs of verify_on.

    structures: a user's own models, fitted in addition. fitted: called with the models as soon as they are
    fitted; the intervals take longer. vehicle: its file, for the verdict on each run. A model that the runs
    do not support is refused with the reason, without an exception. ValueError when two models have one name.
    """
    wanted = settings or Settings()
    names = [s.name for s in structures]
    if taken := [n for i, n in enumerate(names) if n in (*MODELS, "kinematic") or n in names[:i]]:
        raise ValueError(f"a model named {taken[0]!r} exists already; rename the structure")
    together = with_rovers((*runs, *verify_on))
    runs, verify_on = together[: len(runs)], together[len(runs) :]
    quality = tuple(_assessed(run, wanted.condition_on, vehicle) for run in each_with_length(runs))
    runs, verify_on, apart = without_faulty(runs, verify_on, wanted.fitted)
    groups, lowest = grouped(runs, wanted), (wanted.band or ())[:1]
    reasons = {i: why for i, g in enumerate(groups) if (why := g.why_not())}
    remarks = (*apart, *dict.fromkeys(sentences for g in groups for sentences in g.remarks))
    if len(reasons) == len(groups):
        fault = too_short(runs, *lowest)
        short = (f"nothing can be identified: {fault.text}",) if fault else ()
        stops = (*short, *dict.fromkeys(reasons.values()))
        refused = dict.fromkeys((*wanted.models, *names), stops[0])
        return Identification(geometry, wanted, groups, quality, {}, refused, None, (*stops, *remarks))
    remarks = (*(groups[i].left_out(why) for i, why in reasons.items()), *remarks)
    groups = tuple(g for i, g in enumerate(groups) if i not in reasons)
    work = Work(groups, geometry, tuple(verify_on), wanted)
    models, refused = _fitted(work, structures)
    if fitted is not None:
        fitted(models)
    models = with_intervals(models, groups, wanted, geometry.friction)
    models = {n: m.lowered("poor", _doubted(m, geometry)) for n, m in models.items()}
    if doubtful := tuple(doubts(runs)):
        good = {n: m for n, m in models.items() if m.verdict.level == "good"}
        models |= {n: m.lowered("acceptable", doubtful) for n, m in good.items()}
    no_tyres = tyres_not_identifiable(models)
    if no_tyres:
        with_tyres = {n: m for n, m in models.items() if n != "kinematic"}
        models |= {n: m.lowered("not identifiable", (no_tyres,)) for n, m in with_tyres.items()}
    placed = next((models[n] for n in PHYSICAL if n in models), None)
    turned = wrong_place(placed.fit, work.conditions(), geometry) if placed else ""
    of_file = (
        *implausible(geometry),
        *wrong_wheelbase(models["kinematic"], geometry.wheelbase),
        *filter(None, (turned,)),
    )
    others = [run for run in verify_on if any(note.fault == TWO_ROVERS for note in run.notes)]
    judged = (*with_length(_runs(groups), *lowest), *others)
    spoilt: dict[str, tuple[str, ...]] = {}
    for name, m in models.items():
        outputs = [o for o in wanted.fitted if o in m.fit.structure.outputs]
        spoilt[name] = (*(of_file if name in OF_FILE else ()), *fault_sentences(judged, outputs))
    models = {name: m.lowered("poor", spoilt[name]) for name, m in models.items()}
    faults = tuple(dict.fromkeys(sentence for found in spoilt.values() for sentence in found))
    best, sentences = recommendation(models, no_tyres, faults)
    tyres = stiffness_by_amplitude(models[best], work) if best in PHYSICAL else ()
    compared = next((n for n in (best, *PHYSICAL) if n in PHYSICAL and n in models and not no_tyres), None)
    pairs = both_ways(models[compared], work) if compared else ()
    said = (*sentences, *ways_compared(pairs), *remarks)
    return Identification(
        geometry, wanted, groups, quality, models, refused, best, said, by_amplitude=tyres, both_ways=pairs
    )


def _runs(groups: Sequence[Group]) -> tuple[Recording, ...]:
    return tuple(run for group in groups for run in group.runs)


def _doubted(model: ModelResult, geometry: Geometry) -> tuple[str, ...]:
    """Why the numbers of a fit cannot be used: implausible, or without intervals that were asked for."""
    free = [e for e in model.fit.estimates if e.free]
    physical = model.fit.structure.name in PHYSICAL and model.verdict.level != "not identifiable"
    absurd = implausible(geometry, {e.name: e.value for e in free}) if physical else ()
    lost = [e.name for e in free if e.interval_90 and not isfinite(sum(e.interval_90))]
    none = f"no interval of {', '.join(lost)}: more than half of the bootstrap's fits failed"
    return (*absurd, *((none,) if lost else ()))


def _assessed(run: Recording, condition_on: Sequence[str], vehicle: Vehicle | None) -> CoherenceVerdict:
    """The coherence verdict on one run, from partial coherences where another input moves."""
    others = tuple(c for c in condition_on if moving([run], c))
    return assess(run, input_responses([run], ("delta", *others))["delta"] if others else None, vehicle)


def _fitted(
    work: Work, structures: Sequence[ModelStructure]
) -> tuple[dict[str, ModelResult], dict[str, str]]:
    models = {"kinematic": physical_result(kinematic(work.geometry), work)}
    refused: dict[str, str] = {}
    wanted = {name: partial(model_result, name, work) for name in work.settings.models}
    for name, result in (wanted | {s.name: partial(own_result, s, work) for s in structures}).items():
        try:
            models[name] = result()
        except NotPossible as reason:
            refused[name] = str(reason)
    return models, refused


# Which runs and models the answer rests on.


ORDER = ("kinematic", "bicycle", "roll-yaw", "lumped")
TITLES = {"kinematic": "Kinematic", "bicycle": "Bicycle", "roll-yaw": "Roll-yaw", "lumped": "Lumped"}


def ordered(result: Identification) -> dict[str, ModelResult]:
    """The models, ordered from simple to complex; a user's own structures last."""
    known = [n for n in ORDER if n in result.models]
    return {n: result.models[n] for n in [*known, *(n for n in result.models if n not in ORDER)]}


def rejection(result: Identification, name: str) -> str | None:
    """Why the free parameters of a model are not valid: the kinematic model suffices. None if they are valid.

    The fit still returns numbers in that case, but a stiffness that the data cannot distinguish from
    infinity is only fitted noise, and must not be shown as a result.
    """
    if name == "kinematic" or result.models[name].verdict.level != "not identifiable":
        return None
    return tyres_not_identifiable(result.models)


def usable(result: Identification) -> dict[str, ModelResult]:
    """The models with valid numbers, from simple to complex."""
    return {n: m for n, m in ordered(result).items() if rejection(result, n) is None}


def identified_runs(result: Identification) -> tuple[Recording, ...]:
    """The runs of all groups, used in the fit."""
    return tuple(run for group in result.groups for run in group.runs)


def judged_runs(result: Identification) -> tuple[tuple[Recording, CoherenceVerdict | None], ...]:
    """Each run of the groups with its verdict; runs of the same name get the verdicts in order."""
    left = list(result.coherence)
    out = []
    for run in identified_runs(result):
        verdict = next((v for v in left if v.run == run.name), None)
        if verdict:
            left.remove(verdict)
        out.append((run, verdict))
    return tuple(out)


def known_filters(result: Identification) -> Mapping[str, LowPass]:
    """The sensors' low-pass filters included in the models' outputs (of the first group)."""
    return result.groups[0].runs[0].filters


def inertia_of(model: ModelResult) -> Estimate | None:
    """The identified yaw inertia, None if the model has none or it was not free."""
    found = [e for e in model.fit.estimates if e.name == "Izz" and e.free]
    return found[0] if found else None
