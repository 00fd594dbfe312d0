"""Which of several redundant channels is wrong, from the relations that must hold between them.

Each relation compares two quantities that are equal in any rover, such as a_y and V r. Its measured ratio is
the product of the scales of the channels in it, and its sign the product of their signs. A fault (`Fault`)
changes the scale of some channels by a free factor, or the sign of some. With Gaussian errors of the
logarithms, the probability of the measured ratios under a set of faults is that of a linear model

    y = H k + e,   e ~ N(0, diag(sd^2)),   k ~ N(0, sum of BROAD^2 f f^T over the faults),

with y the logarithms of the ratios, H (relations, channels) the exponents, k the logarithms of the channels'
scales and f (channels) the direction of a fault (Rasmussen and Williams, Gaussian Processes for Machine
Learning, 2006, 2.1: the marginal likelihood; a free factor pays for itself). A sign is read wrongly with
probability `MISREAD`. Two relations against one decide because one fault is likelier than two; what
otherwise decides are the prior probabilities, which are how often such faults are in what people bring.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from math import exp, log, pi

import numpy as np

from rover_sweep.data.recording import Array

BROAD = 1.0  # sd of the logarithm of a wrong scale: a factor of 2.7
MISREAD = 0.005  # probability that a relation shows the wrong sign
MOST = 2  # faults at a time
DECIDED = 0.9  # probability from which one explanation is taken


@dataclass(frozen=True)
class ChannelRelation:
    """A measured ratio of two quantities. name: of the relation.

    exponents: {channel: power of its scale in the ratio}; ratio: positive, 1 where all are right, with the
    standard deviation sd of its logarithm. signs: channels of whose signs `sign` (-1, 1) is the product;
    0 where it was not measured.
    """

    name: str
    exponents: Mapping[str, int]
    ratio: float
    sd: float
    signs: tuple[str, ...] = ()
    sign: int = 0


@dataclass(frozen=True)
class ChannelFault:
    """Something wrong with a rover or its log. channel: the one that is named; prior: its probability.

    scaled: channels that have the same wrong factor; turned: channels that have the wrong sign. says: in
    words, with {factor}; remedy: what to do.
    """

    name: str
    channel: str
    prior: float
    scaled: tuple[str, ...] = ()
    turned: tuple[str, ...] = ()
    says: str = ""
    remedy: str = ""


@dataclass(frozen=True)
class FaultSet:
    """One explanation with its probability. scales: {channel: (factor, sd of its logarithm)}."""

    faults: tuple[ChannelFault, ...]
    probability: float
    scales: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def turned(self) -> frozenset[str]:
        """Channels with the wrong sign."""
        return frozenset(channel for fault in self.faults for channel in fault.turned)


def explanations(
    relations: Sequence[ChannelRelation], faults: Sequence[ChannelFault]
) -> tuple[FaultSet, ...]:
    """All sets of at most `MOST` faults, the most probable first. Their probabilities add up to 1."""
    possible = _distinct(relations, faults)
    weighed = [
        (_log_probability(relations, chosen, possible), chosen)
        for count in range(MOST + 1)
        for chosen in combinations(possible, count)
    ]
    most = max(weight for weight, _ in weighed)
    total = sum(exp(weight - most) for weight, _ in weighed)
    found = [
        FaultSet(chosen, exp(weight - most) / total, _scales(relations, chosen)) for weight, chosen in weighed
    ]
    return tuple(sorted(found, key=lambda one: -one.probability))


def _distinct(
    relations: Sequence[ChannelRelation], faults: Sequence[ChannelFault]
) -> tuple[ChannelFault, ...]:
    """The faults that these relations can show; of those that they cannot tell apart the likeliest."""
    scaled = {channel for one in relations for channel in one.exponents}
    turned = {channel for one in relations if one.sign for channel in one.signs}
    effects = {f: (scaled & set(f.scaled), turned & set(f.turned)) for f in faults}
    found: dict[tuple[frozenset[str], frozenset[str]], ChannelFault] = {}
    for fault, (factor, sign) in effects.items():
        effect = frozenset(factor), frozenset(sign)
        if (factor or sign) and (effect not in found or found[effect].prior < fault.prior):
            found[effect] = fault
    return tuple(found.values())


def _log_probability(
    relations: Sequence[ChannelRelation], chosen: Sequence[ChannelFault], possible: Sequence[ChannelFault]
) -> float:
    """Logarithm of prior times likelihood of these faults and no others."""
    found = sum(log(f.prior) if f in chosen else log(1 - f.prior) for f in possible)
    turned = [channel for fault in chosen for channel in fault.turned]
    for one in relations:
        if one.sign:
            expected = (-1) ** sum(turned.count(channel) for channel in one.signs)
            found += log(1 - MISREAD) if one.sign == expected else log(MISREAD)
    y, covariance, _ = _linear_model(relations, chosen)
    if not y.size:
        return found
    _, determinant = np.linalg.slogdet(2 * pi * covariance)
    return found - 0.5 * float(y @ np.linalg.solve(covariance, y)) - 0.5 * float(determinant)


def _linear_model(
    relations: Sequence[ChannelRelation], chosen: Sequence[ChannelFault]
) -> tuple[Array, Array, Array]:
    """(y (n,), its covariance (n, n), what each fault's factor does to y (n, faults))."""
    measured = [one for one in relations if one.exponents]
    y = np.log(np.array([one.ratio for one in measured], float))
    free = [fault for fault in chosen if fault.scaled]
    of_fault = np.zeros((len(measured), len(free)))
    for k, one in enumerate(measured):
        of_fault[k] = [sum(one.exponents.get(channel, 0) for channel in fault.scaled) for fault in free]
    noise = np.diag([one.sd**2 for one in measured]).reshape(len(measured), len(measured))
    return y, noise + BROAD**2 * of_fault @ of_fault.T, of_fault


def _scales(
    relations: Sequence[ChannelRelation], chosen: Sequence[ChannelFault]
) -> dict[str, tuple[float, float]]:
    """{channel: (factor, sd of its logarithm)} of the channels that the faults scale: the posterior of k."""
    free = [fault for fault in chosen if fault.scaled]
    if not free:
        return {}
    y, covariance, of_fault = _linear_model(relations, chosen)
    gain = BROAD**2 * np.linalg.solve(covariance, of_fault).T
    mean = gain @ y
    spread = BROAD**2 * np.eye(len(free)) - BROAD**2 * gain @ of_fault
    return {
        channel: (exp(float(mean[k])), float(np.sqrt(max(spread[k, k], 0.0))))
        for k, fault in enumerate(free)
        for channel in fault.scaled
    }
