"""The DataFlash log of a rover that is simulated without an autopilot around it."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
from pathlib import Path

from sitl.autopilot.log_records import IMU_TEMPERATURE, heading
from sitl.autopilot.vehicle_log import VehicleLog
from sitl.autopilot.vehicle_parameters import ParameterStore
from sitl.geodesy import ORIGIN
from sitl.plant.effects.stamps import late_records
from sitl.plant.effects_table import Effects
from sitl.plant.sensors import Sensors

SWEP = ("Run,St,T,Cmd,Out,VN,VE", "HBfffff", "--sYYnn", "--00000")
"""The applet's message: labels, types, units, multipliers."""

_STEERING, _OUTPUTS = 26, 14


class FlightLog:
    """Messages as ArduRover lays them out, into a new folder. `now_us` is the clock of what is written next.

    parameters: of the recorded vehicle; those that the embedded rover has are in the log's head.
    """

    def __init__(self, folder: Path, parameters: Mapping[str, float], effects: Effects) -> None:
        self.now_us = 0
        self._store = ParameterStore(folder / "parameters.txt")
        for name, value in parameters.items():
            if name in self._store:
                self._store.set(name, value, save=False)
        self._store.set("LOG_DISARMED", 1, save=False)  # nobody arms: the log is open from the beginning
        self._log = VehicleLog(folder, self._store, lambda: self.now_us)
        self._log.late_us = late_records(effects)
        self._steering = next(
            (n for n in range(1, _OUTPUTS + 1) if _function(self._store, n) == _STEERING), 1
        )

    def begin(self, t: float) -> None:
        """Opens the log at the time t [s], with parameters and formats."""
        self.now_us = round(t * 1e6)
        self._log.update()

    def close(self) -> Path:
        """Ends the log; where it is."""
        self._log.close()
        return self._log.files()[-1]

    def text(self, t: float, text: str) -> None:
        """A message to the user."""
        self.now_us = round(t * 1e6)
        self._log.write("MSG", text[:64])

    def loop(self, t: float, sensors: Sensors) -> None:
        """IMU, attitude and estimator after a main loop."""
        self.now_us = round(t * 1e6)
        rate = min(round(sensors.rate_hz), 65535)
        self._log.write("IMU", 0, *sensors.gyro, *sensors.accel, 0, 0, IMU_TEMPERATURE, 1, 1, rate, rate)
        roll, pitch, yaw = sensors.attitude
        angles = degrees(roll), degrees(pitch), heading(yaw)
        self._log.write("ATT", 0.0, angles[0], 0.0, angles[1], 0.0, angles[2], 3)
        velocity, position = sensors.velocity, sensors.position
        self._log.write("XKF1", 0, *angles, *velocity, velocity[2], *position, 0.0, 0.0, 0.0, ORIGIN[2])

    def outputs(self, t: float, steering_us: float) -> None:
        """The servo outputs; all but the steering as if nothing were connected."""
        self.now_us = round(t * 1e6)
        pwm = [0] * _OUTPUTS
        pwm[self._steering - 1] = round(steering_us)
        self._log.write("RCOU", *pwm)

    def applet(self, t: float, run: float, state: float, clock: float, out: float, sensors: Sensors) -> None:
        """A row of the applet with the simulated velocity."""
        self.now_us = round(t * 1e6)
        north, east, _ = sensors.velocity
        labels, codes, units, multipliers = SWEP
        values = (int(run), int(state), clock, out, out, north, east)
        self._log.script_write("SWEP", labels, codes, values, units, multipliers)


def _function(store: ParameterStore, output: int) -> int:
    parameter = store.find(f"SERVO{output}_FUNCTION")
    return 0 if parameter is None else int(parameter.value)
