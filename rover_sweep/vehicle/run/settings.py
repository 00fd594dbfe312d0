"""What the user allows this program to do in a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rover_sweep.errors import UsageError
from rover_sweep.vehicle.run.controls import Trigger


@dataclass(frozen=True)
class RunSettings:
    """What the user allows this program to do in a run.

    arm: arm the rover (the user's consent). throttle_us: drive with this throttle [us]; None: the pilot
    drives. trigger: throw the switch by RC override, by MAV_CMD_DO_AUX_FUNCTION, or ask the pilot. extra:
    limits and other numbers of the applet, named without prefix (v_max, roll_max, still, ...). patience: time
    to wait for the pilot, for arming and for the speed [s of the vehicle's clock].
    """

    arm: bool = False
    throttle_us: int | None = None
    trigger: Trigger = "pilot"
    extra: Mapping[str, float] = field(default_factory=dict)
    patience: float = 120.0

    def __post_init__(self) -> None:
        if self.throttle_us is None:
            return
        if not self.arm:
            raise UsageError("this program drives only a rover that it armed itself; allow arming too")
        if not 1000 <= self.throttle_us <= 2000:
            raise UsageError(f"throttle {self.throttle_us} us is out of range; give 1000 to 2000 us")
