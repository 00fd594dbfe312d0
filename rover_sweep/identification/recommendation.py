"""The recommended model, with the reasons as sentences."""

from __future__ import annotations

from collections.abc import Mapping

from rover_sweep.identification.model_results import MUCH_BETTER, TIED, ModelResult

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
        return None, (_none_fits(models), *filter(None, (no_tyres,)), *faults)
    best = usable[0]
    if no_tyres and best == "kinematic":
        return best, (f"use the kinematic model: {no_tyres}", *faults)
    reasons = models[best].verdict.sentences[: 1 if best == "lumped" else 2]
    others = (*_passed_over(best, models), *_axles_sentence(models[best]), *_lumped_sentence(best, models))
    return best, (f"use the {best} model: {'; '.join(reasons)}", *others, *faults)


def _none_fits(models: Mapping[str, ModelResult]) -> str:
    """Why no model is recommended, with the reasons against the most complete one that was identified."""
    identified = (n for n in ORDER if n in models and models[n].verdict.level != "not identifiable")
    name = next(identified, "kinematic")
    kind = "model" if name == "lumped" else "physical model"
    why = f"{name}: {'; '.join(models[name].verdict.sentences[:2])}"
    return f"no {kind} fits these runs ({why}): use `rover-sweep diagnose` to find what is left out"


def _passed_over(best: str, models: Mapping[str, ModelResult]) -> tuple[str, ...]:
    """A sentence for each more complete physical model that was fitted and is not used."""
    better = [n for n in ORDER[: ORDER.index(best)] if n in models and n in PHYSICAL]
    return tuple(
        f"the {n} model is {models[n].verdict.level}: {models[n].verdict.sentences[0]}" for n in better
    )


def _axles_sentence(best: ModelResult) -> tuple[str, ...]:
    """A sentence where separate stiffnesses of the axles replaced the one C of the paper."""
    tied = best.variants.get(TIED)
    if tied is None:
        return ()
    return (
        f"each axle has its own stiffness: one C for both, as in the paper, has J_ave {tied.average:.1f} "
        f"instead of {best.fit.average:.1f}",
    )


def _lumped_sentence(best: str, models: Mapping[str, ModelResult]) -> tuple[str, ...]:
    """A sentence on why a lumped model with a lower cost is not recommended."""
    lumped = models.get("lumped")
    if best == "lumped" or lumped is None or lumped.fit.average > MUCH_BETTER * models[best].fit.average:
        return ()
    return (
        f"the lumped model fits closer (J_ave {lumped.fit.average:.1f}), but is valid at "
        f"{lumped.fit.speed:.2g} m/s only and its coefficients are not physical properties",
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
