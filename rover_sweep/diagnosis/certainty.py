"""How sure a finding is: the probability that its effect is the right one.

    p = 1/(1 + exp(-(b0 + sum b_k z_k)))

z_k: measures of what speaks for the finding, below; b_k: fitted by `python -m tests.foreign.certainty` to
findings in drawn rovers whose laws the library does not share, so p says how often such a finding was right
there. Logistic calibration: Platt 1999, Probabilistic outputs for support vector machines.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import exp, log

WEIGHTS: Mapping[str, float] = {
    "one": -0.1,
    "clear": 0.55,
    "rivalled": -0.8,
    "remaining": -1.4,
    "judged": 1.6,
    "astray": -0.8,
}
LEAST, MOST = 0.02, 0.98  # the draws are too few to say more


def measures(evidence: Mapping[str, float]) -> dict[str, float]:
    """{name: z} of a finding; the names are those of `WEIGHTS`.

    evidence: see `result.Finding`.
    """
    gain, expected = evidence["gain"], evidence.get("held_out_expected")
    ratio = evidence.get("held_out_gain", 0.0) / expected if expected else 1.0
    return {
        "one": 1.0,
        "clear": min(max(log(gain / evidence["threshold"]), 0.0), 5.0),
        "rivalled": min(evidence["runner_up"], 1.5),
        "remaining": log(1.0 + 10.0 * max(evidence["remaining"], 0.0)),
        "judged": 1.0 if expected else 0.0,
        "astray": min(abs(ratio - 1.0), 1.5),
    }


def probability(evidence: Mapping[str, float]) -> float | None:
    """How often a finding like this one was right; None without the measures (a speed loss)."""
    if "runner_up" not in evidence or not evidence.get("threshold"):
        return None
    score = sum(WEIGHTS[name] * z for name, z in measures(evidence).items())
    return min(max(1.0 / (1.0 + exp(-score)), LEAST), MOST)
