"""The embedded rover without its links: plant, sensors, radio, modes, arming, failsafes, scripts, log.

One object is one boot; `step` is one main loop of SCHED_LOOP_RATE in simulated time. Rules that a ground
station depends on are those of Rover-4.6.3; what is left out: all modes but MANUAL and HOLD, arming by the
steering stick, fences, batteries, missions. EKF and GPS are ready sooner than on the real firmware (there
some 40 s after boot).
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil
from pathlib import Path

from sitl.autopilot.arming_checks import at_arming, before_arming
from sitl.autopilot.radio import Radio
from sitl.autopilot.scripts import Scripts
from sitl.autopilot.servo_outputs import STEERING, STEERING_FULL, THROTTLE, THROTTLE_FULL, ServoOutputs
from sitl.autopilot.vehicle_log import VehicleLog
from sitl.autopilot.vehicle_parameters import Parameter, ParameterStore
from sitl.plant.effects.stamps import late_records
from sitl.plant.plant import Plant
from sitl.plant.sensors import Sensors
from sitl.plant.variant import PlantParameters

MANUAL, HOLD = 0, 4
MODE_NAMES = {MANUAL: "MANUAL", HOLD: "HOLD"}
PLANT_RATE_HZ = 400  # what the plant and its sensors are meant for; also the rate of GYR and ACC
LOOP_RATE_LIMITS = (50, 2000)
READY_MS = 3000
GPS_MS = 5000
ORIGIN_MS = 10_000
INITIALISED, GCS_COMMAND, RC_COMMAND, FAILSAFE = 26, 2, 1, 25  # ModeReason
RADIO_LOST, GCS_LOST = 1, 2
CRITICAL, ERROR, WARNING, NOTICE, INFO = range(2, 7)  # MAV_SEVERITY


class Rover:
    """One boot of the vehicle.

    plant_rate_hz: of plant, sensors and scripts; fewer steps are quicker and coarser. now_us: vehicle time.
    prearm_passed: the checks before arming, as of the last second (Rover::one_second_loop).
    Callbacks, set by whoever links it: on_text(severity, text), on_named_float(name, value),
    on_parameter(parameter).
    """

    def __init__(
        self,
        directory: Path,
        plant: PlantParameters,
        seed: int,
        parameters: ParameterStore,
        plant_rate_hz: int = PLANT_RATE_HZ,
    ) -> None:
        self.directory = directory
        self.parameters = parameters
        low, high = LOOP_RATE_LIMITS
        self.loop_rate = int(min(max(parameters["SCHED_LOOP_RATE"], low), high))
        self.loop_period_us = 1_000_000 // self.loop_rate
        self._substeps = max(1, ceil(plant_rate_hz / self.loop_rate))
        self._substep_us = self.loop_period_us / self._substeps
        self.now_us = 0
        self.ticks = 0
        self.plant = Plant(plant, seed)
        gyro_hz, accel_hz = parameters["INS_GYRO_FILTER"], parameters["INS_ACCEL_FILTER"]
        self.sensors = Sensors(plant, seed, 1e6 / self._substep_us, gyro_hz, accel_hz)
        self.radio = Radio(parameters)
        self.servos = ServoOutputs(parameters, self.loop_period_us)
        self.armed = self.prearm_passed = False
        self.mode = int(parameters["INITIAL_MODE"])
        self.mode = self.mode if self.mode in MODE_NAMES else HOLD
        self.mode_reason = INITIALISED
        self.aux: dict[int, int] = {}
        self.gcs_seen_ms = 0
        self.failsafe_bits = self.failsafe_triggered = 0
        self._failsafe_since_ms = 0
        self.on_text: Callable[[int, str], None] = lambda severity, text: None
        self.on_named_float: Callable[[str, float], None] = lambda name, value: None
        self.on_parameter: Callable[[Parameter], None] = lambda parameter: None
        self.on_sample: Callable[[], None] = lambda: None
        self.log = VehicleLog(directory / "logs", parameters, lambda: self.now_us)
        self.log.late_us = late_records(plant.effects)
        self.log.on_open.append(self._log_mode)
        self.scripts = Scripts(self, directory / "scripts")
        parameters.on_change.append(self._parameter_changed)

    @property
    def now_ms(self) -> int:
        return self.now_us // 1000

    # ---- time

    def step(self) -> None:
        """One main loop."""
        self._advance()
        self.ticks += 1
        if self.due(50):
            self.radio.update(self.now_ms)
            self._radio_failsafe()
        if self.due(7):
            self._mode_switch()
        if self.due(1):
            self.prearm_passed = not self.prearm_faults()
        if self.due(10):
            self._switches()
            self._gcs_failsafe()
            self.log.update()
        steering, throttle = self._drive()
        self.servos.update(steering, throttle, self.armed)

    def due(self, rate_hz: float) -> bool:
        """Whether a task of `rate_hz` runs in this loop (ArduPilot's scheduler counts whole loops)."""
        return self.ticks % max(1, int(self.loop_rate / rate_hz)) == 0

    def _advance(self) -> None:
        """Plant, sensors and scripts over one loop period; scripts run concurrently with the main loop."""
        steering, throttle = self._actuators()
        start = self.now_us
        for k in range(1, self._substeps + 1):
            self.plant.step(steering, throttle, self._substep_us * 1e-6)
            self.sensors.update(self.plant.state)
            self.now_us = start + round(k * self._substep_us)
            self.on_sample()
            if self.now_us >= READY_MS * 1000:
                self.scripts.poll()

    def _actuators(self) -> tuple[int, int]:
        """PWM at the steering servo and at the motor controller, 0 where no output has the function."""
        steering, throttle = self.servos.channel_of(STEERING), self.servos.channel_of(THROTTLE)
        pwm = self.servos.pwm
        return (0 if steering is None else pwm[steering], 0 if throttle is None else pwm[throttle])

    @property
    def origin_set(self) -> bool:
        """Whether the estimator has an origin, and with it position and velocity."""
        return self.now_ms >= ORIGIN_MS

    # ---- driving

    def _drive(self) -> tuple[float, float]:
        """(steering -4500..4500, throttle -100..100) of the mode; nothing without radio."""
        if self.mode != MANUAL or self.failsafe_bits & RADIO_LOST or not self.radio.seen:
            return 0.0, 0.0
        p = self.parameters
        throttle = self.radio.angle(int(p["RCMAP_THROTTLE"]), THROTTLE_FULL)
        steering = self.radio.angle(int(p["RCMAP_ROLL"]), STEERING_FULL)
        if throttle < 0 and p["PILOT_STEER_TYPE"] in (0, 3):
            steering = -steering  # the turn reverses when backing up
        return steering, throttle

    def set_mode(self, mode: int, reason: int) -> bool:
        """Change the mode; False if this rover does not have it."""
        if mode not in MODE_NAMES:
            self.text(
                NOTICE, f"Flight mode change to mode {mode} failed: the embedded rover has MANUAL and HOLD"
            )
            return False
        if mode != self.mode:
            self.mode, self.mode_reason = mode, reason
            self._log_mode()
        return True

    def _log_mode(self) -> None:
        self.log.write("MODE", self.mode, self.mode, self.mode_reason)

    # ---- switches

    def _switches(self) -> None:
        if not self.radio.seen:
            return
        for channel, function, position in self.radio.switch_changes(self.now_ms):
            self.text(INFO, f"RC{channel}: function {function} {('LOW', 'MIDDLE', 'HIGH')[position]}")
            self.run_aux(function, position)

    def run_aux(self, function: int, position: int) -> bool:
        """An auxiliary function from a switch or MAV_CMD_DO_AUX_FUNCTION; scripting's need only be kept."""
        if not 300 <= function <= 315:
            return False
        self.aux[function] = position
        return True

    def _mode_switch(self) -> None:
        position = self.radio.mode_switch_change(self.now_ms)
        if position is not None:
            self.set_mode(int(self.parameters[f"MODE{position}"]), RC_COMMAND)

    # ---- arming

    def prearm_faults(self) -> tuple[str, ...]:
        """The failed checks of a disarmed rover, in ArduRover's words."""
        if self.now_ms < READY_MS:
            return ("System not initialised",)
        no_radio = bool(self.failsafe_bits & RADIO_LOST) or not self.radio.seen
        return before_arming(self.parameters, no_radio, self.scripts.error)

    def run_prearm_checks(self) -> bool:
        """MAV_CMD_RUN_PREARM_CHECKS: reports each failed check; False while armed."""
        if self.armed:
            return False
        for fault in self.prearm_faults():
            self.text(CRITICAL, f"PreArm: {fault}")
        return True

    def arm(self, forced: bool = False) -> bool:
        """Arms, or reports the reasons and returns False."""
        if self.armed:
            return True
        faults = () if forced and self.now_ms >= READY_MS else self.prearm_faults()
        if faults := faults or (() if forced else at_arming(self.parameters, self.radio)):
            for fault in faults:
                self.text(CRITICAL, f"Arm: {fault}")
            return False
        if self.parameters["ARMING_CHECK"] == 0:
            self.text(WARNING, "Warning: Arming Checks Disabled")
        self.armed = True
        self.log.set_armed(True)
        self._log_arming(10, forced)
        self.text(INFO, "Throttle armed")
        return True

    def disarm(self, forced: bool = False) -> None:
        """Disarms: the motor stops; steering still moves."""
        if not self.armed:
            return
        self.armed = False
        self._log_arming(11, forced)
        self.text(INFO, "Throttle disarmed")
        self.log.set_armed(False)

    def _log_arming(self, event: int, forced: bool) -> None:
        mavlink_method = 1
        self.log.write("ARM", self.armed, int(self.parameters["ARMING_CHECK"]), forced, mavlink_method)
        self.log.write("EV", event)

    # ---- failsafes

    def _radio_failsafe(self) -> None:
        if self.parameters["FS_THR_ENABLE"] and self.now_ms > READY_MS:
            self._failsafe(RADIO_LOST, "Radio", self.radio.lost(self.now_ms))

    def _gcs_failsafe(self) -> None:
        if self.parameters["FS_GCS_ENABLE"] and self.gcs_seen_ms:
            silent_ms = self.now_ms - self.gcs_seen_ms
            self._failsafe(GCS_LOST, "GCS", silent_ms >= self.parameters["FS_GCS_TIMEOUT"] * 1000)

    def _failsafe(self, kind: int, name: str, on: bool) -> None:
        """Rover::failsafe_trigger: after FS_TIMEOUT overrides are cleared and FS_ACTION is taken."""
        before = self.failsafe_bits
        self.failsafe_bits = before | kind if on else before & ~kind
        if not before and self.failsafe_bits:
            self._failsafe_since_ms = self.now_ms
        if self.failsafe_triggered and not self.failsafe_bits:
            self.text(INFO, f"{name} Failsafe Cleared")
        self.failsafe_triggered &= self.failsafe_bits
        waited = self.now_ms - self._failsafe_since_ms > self.parameters["FS_TIMEOUT"] * 1000
        hold_counts = int(self.parameters["FS_OPTIONS"]) & 1 or self.mode != HOLD
        if self.failsafe_triggered or not self.failsafe_bits or not waited or not hold_counts:
            return
        self.failsafe_triggered = self.failsafe_bits
        self.text(WARNING, f"{name} Failsafe")
        self.radio.clear_overrides()
        action = int(self.parameters["FS_ACTION"])
        if action == 5:  # terminate
            self.disarm()
        elif action != 0:  # RTL and SmartRTL fall back to Hold here, as without a position there
            self.set_mode(HOLD, FAILSAFE)

    # ---- telling

    def text(self, severity: int, text: str) -> None:
        """STATUSTEXT to every link, MSG into the log."""
        self.log.write("MSG", text[:64])
        self.on_text(severity, text)

    def _parameter_changed(self, parameter: Parameter) -> None:
        if parameter.name in ("INS_GYRO_FILTER", "INS_ACCEL_FILTER"):
            self.sensors.set_filters(self.parameters["INS_GYRO_FILTER"], self.parameters["INS_ACCEL_FILTER"])
        self.on_parameter(parameter)
