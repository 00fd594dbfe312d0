"""The plant of tests/foreign as an engine: all its laws, in all their forms."""

from __future__ import annotations

import numpy as np

from tests.engines.engine import Array, Engine, EngineRover, Signals
from tests.foreign.grade import PLACES
from tests.foreign.laws import LISTED
from tests.foreign.outside_laws import OUTSIDE_LAWS
from tests.foreign.plant import STATES, integrated
from tests.foreign.recorded import felt
from tests.foreign.rover import SIZES


def _signals(rover: EngineRover, command: Array, wanted: Array, around: Array, heading: float) -> Signals:
    start = np.zeros(STATES)
    start[5] = heading
    return felt(integrated(command, wanted, around, start, rover.numbers), rover)


ENGINE = Engine("foreign", SIZES, _signals, LISTED, OUTSIDE_LAWS, PLACES)
