"""The vehicle's parameters by MAVSDK's param plugin, with the interface of `sources.ParameterSource`."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rover_sweep.errors import LinkError
from rover_sweep.files.printable import printable
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavsdk_rider import MavsdkRider
from rover_sweep.vehicle.parameters.read_write import ParameterKept, ParameterMissing, Written, float32

if TYPE_CHECKING:
    from mavsdk.plugins.param import Param


@dataclass(frozen=True)
class MavsdkParameters:
    """MAVSDK distinguishes integers and floats; here all are floats, as in MAVLink."""

    link: Link

    def read_all(self, progress: Callable[[int, int], None] | None = None) -> dict[str, float]:
        """Every parameter, by name. MAVSDK reports no progress. LinkError if none came."""
        with MavsdkRider(self.link) as rider:
            found = rider.call(_plugin(rider).get_all_params)
        values = {printable(p.name): float(p.value) for p in (*found.int_params, *found.float_params)}
        if not values:
            raise LinkError("MAVSDK received no parameters: the link loses too much; use --via mavlink")
        if progress is not None:
            progress(len(values), len(values))
        return values

    def write(self, name: str, value: float) -> Written:
        """Set a parameter if it differs, read it back and compare as float32, as `read_write.write`."""
        with MavsdkRider(self.link) as rider:
            plugin = _plugin(rider)
            old, whole = _read(rider, plugin, name)
            wanted = float32(value)
            if old == wanted:
                return Written(name, old, old)
            set_it: Callable[[str, Any], object] = plugin.set_param_int if whole else plugin.set_param_float
            given = int(wanted) if whole else wanted
            with suppress(LinkError):  # a value that is refused reads back as the old one
                _tried(rider, name, lambda: set_it(name, given))
            back, _ = _read(rider, plugin, name)
        if back != wanted:
            raise ParameterKept(name, value, back)
        return Written(name, old, back)


def _plugin(rider: MavsdkRider) -> Param:
    from mavsdk.plugins.param import Param

    return Param(rider.system)


def _read(rider: MavsdkRider, plugin: Param, name: str) -> tuple[float, bool]:
    """(value, whether it is an integer). MAVSDK must be asked with the right type."""
    from mavsdk.plugins.param import ParamError

    try:
        return float32(rider.call(lambda: plugin.get_param_float(name))), False
    except ParamError as error:
        if "WRONG_TYPE" not in str(error):
            raise ParameterMissing(f"MAVSDK did not receive the parameter {name} ({error})") from error
    return float32(_tried(rider, name, lambda: plugin.get_param_int(name))), True


def _tried(rider: MavsdkRider, name: str, call: Callable[[], Any]) -> Any:
    from mavsdk.plugins.param import ParamError

    try:
        return rider.call(call)
    except ParamError as error:
        raise LinkError(f"MAVSDK could not read or set {name} ({error})") from error
