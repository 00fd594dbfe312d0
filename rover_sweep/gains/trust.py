"""Why a model may not set gains: it was not tested on a held-out run, or its numbers are implausible."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.plausibility import implausible
from rover_sweep.identification.verdicts import J_RMS_GUIDE, TIC_GUIDE

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
