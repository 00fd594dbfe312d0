"""Which model to use, and why, in words."""

from __future__ import annotations

from collections.abc import Mapping

from rover_sweep.identification.model_results import ModelResult

ORDER = ("roll-yaw", "bicycle", "lumped", "kinematic")  # physical ones first: they carry to other speeds
NONE_FITS = "no model fits these runs: see the verdict of each"
MUCH_BETTER = 0.7  # of J_ave: from here on the other fit deserves a word
WHEELBASE_RATIO = 2.0  # effective over measured wheelbase, either way: more is a mistake in units or scale


def recommendation(
    models: Mapping[str, ModelResult], wheelbase: float, too_much: str | None, spoilt: tuple[str, ...] = ()
) -> tuple[str | None, tuple[str, ...]]:
    """(name of the model to use or None, sentences, the weightiest first).

    too_much: why tyre parameters mean nothing here, None where they do. wheelbase: a + b [m].
    spoilt: faults of the data, for which models made from them are not good.
    """
    doubt = (*spoilt, *_wheelbase_words(models["kinematic"], wheelbase))
    if too_much and not spoilt:
        return "kinematic", (f"use the kinematic model: {too_much}", *doubt)
    usable = [n for n in ORDER if n in models and models[n].verdict.level in ("good", "acceptable")]
    if not usable:
        first = "the data are faulty, so use no model of them" if spoilt else NONE_FITS
        return None, (first, *doubt)
    best = usable[0]
    reasons = models[best].verdict.sentences[: 1 if best == "lumped" else 2]
    others = (*_untied_words(models[best]), *_lumped_words(best, models))
    return best, (f"use the {best} model: {'; '.join(reasons)}", *others, *doubt)


def _untied_words(best: ModelResult) -> tuple[str, ...]:
    """Where one C for both axles is what costs."""
    free = best.variants.get("Cf and Cr free")
    if free is None or free.average > MUCH_BETTER * best.fit.average:
        return ()
    axles = " and ".join(f"{n} {free[n].value:.3g}" for n in ("Cf", "Cr"))
    return (
        f"freeing the two axles (--untied) lowers J_ave from {best.fit.average:.1f} to {free.average:.1f}: "
        f"{axles} N/rad",
    )


def _lumped_words(best: str, models: Mapping[str, ModelResult]) -> tuple[str, ...]:
    """Why a lumped model that fits better is not the one to use."""
    lumped = models.get("lumped")
    if best == "lumped" or lumped is None or lumped.fit.average > MUCH_BETTER * models[best].fit.average:
        return ()
    return (
        f"the lumped model fits closer (J_ave {lumped.fit.average:.1f}), but holds at {lumped.fit.speed:.2g} "
        "m/s only and names no property of the rover",
    )


def _wheelbase_words(plain: ModelResult, wheelbase: float) -> tuple[str, ...]:
    """A sentence where the rover turns far less or more than its wheelbase allows."""
    ratio = plain.fit["L_eff"].value / wheelbase
    if 1 / WHEELBASE_RATIO < ratio < WHEELBASE_RATIO:
        return ()
    return (
        f"the yaw rate is {1 / ratio:.2g} times what the wheelbase of {wheelbase:.3g} m gives: check "
        "rad_per_us, the axle distances, and the units of the yaw rate and the speed",
    )
