"""The season of measured logs, with the vehicle files that they were measured with."""

from __future__ import annotations

from collections.abc import Sequence

from threadpoolctl import threadpool_limits

from rover_sweep.batch.vehicle_files import VehicleFiles
from rover_sweep.data.vehicle_file import parse
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.season.measured_log import MeasuredLog
from rover_sweep.season.season import season
from rover_sweep.season.season_result import Season


@threadpool_limits.wrap(limits=1, user_api="blas")  # so that sums do not depend on the number of threads
def season_of_logs(logs: Sequence[MeasuredLog], files: VehicleFiles) -> Season:
    """The season; the result depends on the logs and files only."""
    used = sorted({log.vehicle_file for log in logs if log.fit is not None})
    return season(logs, {name: geometry_of(parse(files.texts[name], name)) for name in used})
