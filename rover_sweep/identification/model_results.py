"""Each model on the runs: its fit, useful variants of the fit, verification, verdict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Array, Recording, data_frame, drawing
from rover_sweep.data.results import ByName, PlainNumbers, Quantity, ShortTable, Shown
from rover_sweep.data.vehicle_file import MODELS
from rover_sweep.identification.conversion import to_control
from rover_sweep.identification.fit import (
    Condition,
    Estimate,
    FitResult,
    costs,
    drawn_starts,
    fit,
    is_stable,
    near_starts,
)
from rover_sweep.identification.grouping import Group, Settings, grouped
from rover_sweep.identification.models import bicycle, kinematic, lumped, roll_yaw
from rover_sweep.identification.state_space import ModelStructure
from rover_sweep.identification.verdicts import (
    CANNOT,
    LEVELS,
    Level,
    ModelVerdict,
    ReductionStep,
    judge_model,
    kinematic_suffices,
    reduce_model,
)
from rover_sweep.identification.verify import UNITS, Verification, verify
from rover_sweep.quality.verdict import driven_amplitude

UNTIED, TIED = "Cf and Cr free", "one C for both axles"
MUCH_BETTER = 0.7  # of J_ave: below it, separate stiffnesses of the axles replace the one for both
LEAST_BETTER = 2.0  # of J_ave: a smaller difference is not worth another parameter


@dataclass(frozen=True, eq=False, repr=False)
class ModelResult(PlainNumbers, Shown):
    """One model: its fit, variants of the fit, verification, verdict.

    costs: J of all responses of the model at this fit, also of those not fitted. variants: further fits named
    "filters ignored", "four responses", "Cf and Cr free", "before reduction", where they apply. Where "Cf and
    Cr free" fits much better it is `fit` too, and "one C for both axles" is the fit of the paper.
    """

    fit: FitResult
    costs: Mapping[str, float]
    variants: Mapping[str, FitResult]
    verification: tuple[Verification, ...]
    verdict: ModelVerdict
    reduction: tuple[ReductionStep, ...] = ()

    @property
    def parameters(self) -> ByName[Estimate]:
        """The parameters by name, as in identification.json (models.<name>.parameters.C.value).

        >>> tau = result.models["roll-yaw"].parameters["tau"]
        >>> round(tau.value, 2), tau.unit, tau.free, tau.interval_90 is not None
        (0.04, 's', True, True)
        >>> "Izz" in result.models["roll-yaw"].parameters
        True
        """
        return self.fit.parameters

    def __getitem__(self, name: str) -> Estimate:
        """A parameter by its name; KeyError lists the names.

        >>> result.models["roll-yaw"]["Izz"].unit
        'kg m^2'
        """
        return self.parameters[name]

    @property
    def A(self) -> Array:
        """System matrix (nx, nx) of x' = A x + B u at the speed of the fit, u delayed by `tau`; SI units.

        States, inputs and outputs: `fit.structure.states`, `.inputs`, `.outputs`.

        >>> model = result.models["bicycle"]
        >>> model.fit.structure.states, model.A.shape, model.C.shape
        (('beta', 'r'), (2, 2), (3, 2))
        """
        return self._state_space()[0]

    @property
    def B(self) -> Array:
        """Input matrix (nx, nu), see `A`."""
        return self._state_space()[1]

    @property
    def C(self) -> Array:
        """Output matrix (ny, nx) of y = C x + D u, see `A`."""
        return self._state_space()[2]

    @property
    def D(self) -> Array:
        """Feedthrough (ny, nu), see `C`."""
        return self._state_space()[3]

    def _state_space(self) -> tuple[Array, Array, Array, Array]:
        return self.fit.structure.matrices(self.fit.speed).state_space()

    def to_control(self, pade: int = 2) -> Any:
        """`control.StateSpace` with the delay as a Pade form of this order; as `rs.to_control`."""
        return to_control(self, pade=pade)

    @property
    def modes(self) -> ByName[Quantity]:
        """Natural frequency [rad/s], damping ratio and time constant [s] of the yaw and the roll mode.

        At the speed of the fit. With 90 % intervals from the bootstrap, where there is one, which of the
        bicycle and roll-yaw models also include errors of the structure. Empty for a model without modes.

        >>> result.models["roll-yaw"].modes.keys()[:3]
        ('yaw_frequency', 'yaw_damping', 'yaw_time_constant')
        """
        return self.fit.modes

    def plot(self, axes: Any = None) -> Any:
        """Draws the first verification run, measured and predicted; returns matplotlib axes (channels,).

        axes: one for each channel; default a new figure. UsageError for a model without a verification run.
        `Result.plot` draws the responses and the models.

        >>> len(result.models["roll-yaw"].plot())
        3
        """
        return drawing("draw_model")(self, axes)

    def to_frame(self) -> Any:
        """The parameters as a pandas.DataFrame with the name as index; UsageError without pandas.

        Columns as the keys of identification.json: value, unit, free, cr_percent, insensitivity_percent, low
        and high (ends of interval_90), sd, bias, at_bound, meaning; nan where there is no number.

        >>> frame = result.models["roll-yaw"].to_frame()
        >>> frame.loc["Izz", "unit"], bool(frame.loc["Izz", "low"] < frame.loc["Izz", "high"])
        ('kg m^2', True)
        """
        found = self.parameters
        none = (float("nan"),) * 2
        plain = ("value", "unit", "free", "cr_percent", "insensitivity_percent")
        columns: dict[str, Any] = {name: [getattr(e, name) for e in found] for name in plain}
        columns["low"], columns["high"] = zip(*(e.interval_90 or none for e in found), strict=True)
        columns |= {name: [getattr(e, name) for e in found] for name in ("sd", "bias", "at_bound", "meaning")}
        return data_frame(columns, found.keys(), "parameter")

    @property
    def average_all(self) -> float:
        """J_ave over all responses of the model, fitted or not."""
        return float(np.mean(list(self.costs.values())))

    def lowered(self, level: Level, why: tuple[str, ...]) -> ModelResult:
        """The result with its verdict limited to this level if `why` (sentences) is not empty."""
        if not why:
            return self
        worst = max(level, self.verdict.level, key=LEVELS.index)
        return replace(
            self, verdict=ModelVerdict(worst, tuple(dict.fromkeys((*why, *self.verdict.sentences))))
        )

    def table(self) -> ShortTable:
        """The fit's table with the verdict and the verification."""
        fit = self.fit.table()
        verdict = f"{self.verdict.level}: {'; '.join(self.verdict.sentences)}"
        checks = tuple(f"on {v.run}: J_rms {v.j_rms:.2f}, TIC {v.tic:.3f}" for v in self.verification)
        return replace(fit, notes=(*fit.notes, *checks, verdict))


@dataclass(frozen=True, eq=False)
class Work:
    """The data and settings shared by all models. verify_on: runs that are not fitted."""

    groups: tuple[Group, ...]
    geometry: Geometry
    verify_on: tuple[Recording, ...]
    settings: Settings

    def conditions(self, outputs: Sequence[str] | None = None, filtered: bool = True) -> list[Condition]:
        """The data of the cost, one condition per group. outputs: default the fitted ones."""
        return [g.condition(outputs or self.settings.fitted, filtered) for g in self.groups]

    @property
    def has_vydot(self) -> bool:
        """True when V_y'/delta has a usable band at every speed and is not fitted already."""
        return "vydot" not in self.settings.fitted and all(g.usable("vydot") for g in self.groups)


def tyres_not_identifiable(models: Mapping[str, ModelResult]) -> str | None:
    """A sentence on why tyre parameters cannot be identified from these results, or None."""
    return kinematic_suffices({name: model.costs for name, model in models.items()})


class NotPossible(Exception):
    """A model that cannot be identified from these runs or this vehicle file; the text says why."""


def model_result(name: str, work: Work) -> ModelResult:
    """Fits one of MODELS to the runs; raises NotPossible with the reason."""
    if name == "bicycle":
        return physical_result(bicycle(work.geometry, work.settings.tied), work)
    if name not in MODELS:
        raise ValueError(f"there is no model {name!r}; the models are {', '.join(MODELS)}")
    need_roll(name, work)
    structure = roll_yaw(work.geometry, work.settings.tied)
    if name == "lumped":
        return lumped_result(structure, work)
    return physical_result(
        structure.with_free([*(p.name for p in structure.free), *work.geometry.free]), work
    )


def need_roll(name: str, work: Work) -> None:
    """Raises NotPossible, with the reason, if runs or vehicle file allow no model with roll."""
    geometry, p = work.geometry, work.groups[0].responses.get("p")
    if None in (geometry.sprung_mass, geometry.h, geometry.roll_inertia):
        raise NotPossible(
            f"the {name} model needs sprung_mass, cg_height_above_roll_centre and roll_inertia "
            "in the vehicle file"
        )
    if geometry.h is not None and geometry.h <= 0:
        raise NotPossible(
            f"the {name} model needs a CG above the roll axis, but cg_height_above_roll_centre is "
            f"{geometry.h:g} m"
        )
    if p is None or p.band is None:
        best = "it was not recorded" if p is None else f"its highest coherence is {np.max(p.coherence):.2f}"
        raise NotPossible(
            f"the {name} model cannot be identified: the roll rate does not follow the steering ({best})"
        )


def physical_result(structure: ModelStructure, work: Work) -> ModelResult:
    """A structure of physical parameters, fitted over all speeds and reduced, with its variants."""
    starts = drawn_starts(structure)
    full = fit(structure, work.conditions(), starts)
    usual = {"C", "Cf", "Cr", "Izz", "k_phi", "b_phi", "L_eff"}
    more = {p.name: p.value for p in structure.free if p.name in work.geometry.free and p.name not in usual}
    best, steps = _reduced(full, work, more)  # of the parameters that the vehicle file frees in addition
    if steps:
        best = fit(best.structure, work.conditions(), drawn_starts(best.structure))
    tied, apart = best, None
    if "C" in structure.values:
        make = bicycle if structure.name == "bicycle" else roll_yaw
        free = [n for p in tied.structure.free for n in (("Cf", "Cr") if p.name == "C" else (p.name,))]
        both = dict.fromkeys(("Cf", "Cr"), tied.structure.values["C"])
        start = make(work.geometry, tied=False).with_free(free)
        apart = fit(start.with_values({**tied.structure.values, **both}), work.conditions())
        much_better = apart.average <= min(MUCH_BETTER * tied.average, tied.average - LEAST_BETTER)
        if much_better and not work.settings.as_paper and judge_model(apart).level != "not identifiable":
            best = apart
    variants = {"before reduction": full} if any(s.dropped for s in steps) else {}
    if any(g.runs[0].filters for g in work.groups):
        begin = starts if best is tied else ()
        variants["filters ignored"] = fit(best.structure, work.conditions(filtered=False), begin)
    if "vydot" in structure.outputs and work.has_vydot:
        variants["four responses"] = fit(best.structure, work.conditions(structure.outputs))
    if apart is not None:
        variants |= {UNTIED: apart} | ({TIED: tied} if best is apart else {})
    return fitted_result(best, variants, work, steps)


def _reduced(
    full: FitResult, work: Work, known: Mapping[str, float] | None
) -> tuple[FitResult, tuple[ReductionStep, ...]]:
    if not work.settings.reduction or known == {}:
        return full, ()
    return reduce_model(full, work.conditions(), known, work.settings.keep)


def lumped_result(start: ModelStructure, work: Work) -> ModelResult:
    """The lumped model at the first speed, from the derivatives of a roll-yaw fit, reduced.

    Its costs are those over the runs of all speeds in the same direction, as the costs of the other models.
    """
    same_way = tuple(g for g in work.groups if g.speed * work.groups[0].speed > 0)
    work = replace(work, groups=same_way)
    here = Work(work.groups[:1], work.geometry, work.verify_on, work.settings)
    conditions = here.conditions()
    first = fit(start, conditions, drawn_starts(start)).structure
    full = fit(lumped(work.geometry, first, here.groups[0].speed), conditions, stable=True)
    best, steps = _reduced(full, here, None)
    # distant starts end in wrong local minima
    near = [s for s in near_starts(best.structure) if is_stable(best.structure.with_values(s), conditions)]
    best = fit(best.structure, conditions, near, stable=True)
    variants = {"before reduction": full} if steps else {}
    if here.has_vydot:
        variants["four responses"] = fit(best.structure, here.conditions(best.structure.outputs))
    everywhere = {name: _over_all_runs(f, work) for name, f in variants.items()}
    found = fitted_result(_over_all_runs(best, work), everywhere, work, steps)
    if len(work.groups) == 1:
        return found
    where = f"fitted at {best.speed:.2f} m/s only, where J_ave is {best.average:.1f}"
    return replace(found, verdict=replace(found.verdict, sentences=(*found.verdict.sentences, where)))


def _over_all_runs(found: FitResult, work: Work) -> FitResult:
    return replace(found, costs=costs(found.structure, work.conditions(tuple(found.costs))))


def fitted_result(
    best: FitResult, variants: Mapping[str, FitResult], work: Work, steps: tuple[ReductionStep, ...] = ()
) -> ModelResult:
    """A fit with its costs of all responses, verification and verdict."""
    structure = best.structure
    all_costs = costs(structure, work.conditions(structure.outputs))
    usable = [run for run in work.verify_on if any(c in run and c in structure.outputs for c in UNITS)]
    verification = tuple(verify(structure, run) for run in usable)
    verdict = judge_model(best, physical=structure.name != "lumped", verification=verification)
    return ModelResult(best, all_costs, variants, verification, verdict, steps)


# The stiffness of the tyres at each amplitude: a tyre bends, so larger slip angles show a smaller one.


STIFFNESSES = ("C", "Cf", "Cr")
OTHER_AMPLITUDE = 1.25  # ratio of amplitudes from which their stiffnesses are compared


@dataclass(frozen=True)
class RunStiffness:
    """Cornering stiffness from one run alone, the other parameters as fitted to all runs.

    speed [m/s]; amplitude of the steering, in "us", or "rad" where no PWM was recorded; stiffness {"C", or
    "Cf" and "Cr": value [N/rad] of an axle}.
    """

    run: str
    speed: float
    amplitude: float
    unit: str
    stiffness: Mapping[str, float]


def stiffness_by_amplitude(model: ModelResult, work: Work) -> tuple[RunStiffness, ...]:
    """Stiffness from each run alone, small amplitudes first; () where all amplitudes are about equal."""
    structure = model.fit.structure
    names = [p.name for p in structure.free if p.name in STIFFNESSES]
    driven = [(run, *driven_amplitude(run)) for group in work.groups for run in group.runs]
    sizes = [size for _, size, _ in driven]
    if not names or len({unit for *_, unit in driven}) > 1 or max(sizes) < OTHER_AMPLITUDE * min(sizes):
        return ()
    out = []
    for run, size, unit in sorted(driven, key=lambda one: one[1]):
        alone = grouped([run], work.settings)[0]
        if alone.why_not():
            continue
        found = fit(structure.with_free(names), [alone.condition(work.settings.fitted)])
        stiffness = {name: found[name].value for name in names}
        out.append(RunStiffness(run.name, alone.speed, size, unit, stiffness))
    return tuple(out) if len(out) > 1 else ()


# The model that a diagnosis tests if the user names none: the most complete one that the runs determine.
#
# As in `recommendation`, tyres are no part of it where the kinematic model fits as well, and roll is none
# where the roll rate does not follow the steering. A poor fit counts for nothing here: what it lacks is
# asked for.


Determined = Literal["roll-yaw", "bicycle", "kinematic"]


def determined_model(groups: Sequence[Group], geometry: Geometry) -> tuple[Determined, str]:
    """(most complete model that the groups determine, why not a more complete one: "" for roll-yaw)."""
    sound = tuple(g for g in groups if not g.why_not())
    if not sound:  # refused later, with the reason
        return "roll-yaw", ""
    work = Work(sound, geometry, (), Settings())
    found = {}
    for structure in (kinematic(geometry), bicycle(geometry)):
        best = fit(structure, work.conditions(), drawn_starts(structure)).structure
        found[structure.name] = costs(best, work.conditions(structure.outputs))
    if why := kinematic_suffices(found):
        return "kinematic", why
    try:
        need_roll("roll-yaw", work)
    except NotPossible as reason:
        return "bicycle", str(reason)
    return "roll-yaw", ""


# The recommended model, with the reasons as sentences.


PHYSICAL = ("roll-yaw", "bicycle")  # valid at other speeds, the more complete one first
ORDER = (*PHYSICAL, "lumped", "kinematic")
USABLE = ("good", "acceptable")
WHEELBASE_RATIO = 2.0  # of effective and measured wheelbase, either way; more indicates a wrong unit or scale


def recommendation(
    models: Mapping[str, ModelResult], no_tyres: str | None, faults: tuple[str, ...] = ()
) -> tuple[str | None, tuple[str, ...]]:
    """(name of the model to use or None, sentences, most important first).

    no_tyres: a sentence on why tyre parameters cannot be identified, or None. faults: sentences on faults of
    the data and of the vehicle file.
    """
    usable = [n for n in ORDER if n in models and models[n].verdict.level in USABLE]
    if faults and usable in ([], ["kinematic"]):
        return None, (f"use none of these models: {faults[0]}", *faults[1:])
    if not usable:
        identified = (n for n in ORDER if n in models and models[n].verdict.level != "not identifiable")
        name = next(identified, "kinematic")
        kind = "model" if name == "lumped" else "physical model"
        why = f"{name}, {'; '.join(models[name].verdict.sentences[:2])}"
        none = f"no {kind} fits these runs ({why}); use `rover-sweep diagnose` to find what is left out"
        return None, (none, *filter(None, (no_tyres,)), *faults)
    best = usable[0]
    if no_tyres and best == "kinematic":
        return best, (f"use the kinematic model: {no_tyres}", *faults)
    reasons = models[best].verdict.sentences[: 1 if best == "lumped" else 2]
    others = tuple(_beside(best, models))
    return best, (f"use the {best} model: {'; '.join(reasons)}", *others, *faults)


def _beside(best: str, models: Mapping[str, ModelResult]) -> Iterator[str]:
    """Sentences on the other models: more complete, with one C for both axles, with a lower cost."""
    for n in ORDER[: ORDER.index(best)]:
        if n in models and n in PHYSICAL:
            verdict = models[n].verdict
            yield f"the {n} model is {verdict.level}: {verdict.sentences[0].removeprefix(CANNOT)}"
    fit, tied, lumped = models[best].fit, models[best].variants.get(TIED), models.get("lumped")
    if tied is not None:
        yield (
            f"each axle has its own stiffness: one C for both, as in the paper, has J_ave {tied.average:.1f} "
            f"instead of {fit.average:.1f}"
        )
    if best in PHYSICAL and lumped and round(lumped.fit.average, 1) < round(fit.average, 1):  # as printed
        yield (
            f"the lumped model has a lower J_ave ({lumped.fit.average:.1f}), but it is valid at "
            f"{lumped.fit.speed:.2g} m/s only and its coefficients are not physical properties; the {best} "
            "model fits well enough, and its parameters hold at other speeds too"
        )


def wrong_wheelbase(plain: ModelResult, wheelbase: float) -> tuple[str, ...]:
    """A sentence when the rover turns far less or far more than its wheelbase gives."""
    ratio = plain.fit["L_eff"].value / wheelbase
    if 1 / WHEELBASE_RATIO < ratio < WHEELBASE_RATIO:
        return ()
    return (
        f"the yaw rate is {1 / ratio:.2g} times that expected from the wheelbase of {wheelbase:.3g} m: check "
        "rad_per_us, the axle distances, and the units of the yaw rate and the speed",
    )
