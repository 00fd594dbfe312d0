"""MAV_CMDs that the embedded rover obeys, with the results that ArduRover 4.6.3 gives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.rover import GCS_COMMAND, Rover
from sitl.ground.message_intervals import StreamSchedule
from sitl.ground.messages import BUILDERS

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)  # MAV_RESULT
FORCE_ARM = (2989.0, 21196.0)
FORCE_DISARM = 21196.0
SCRIPTING_STOP, SCRIPTING_RESTART = 2, 3
Numbers = Sequence[float]


class AnsweringLink(Protocol):
    """How a command changes the message rates of the link it came from."""

    def schedule_of(self, message_id: int) -> StreamSchedule:
        """How often a message goes out."""

    def send_message(self, message: mavlink.MAVLink_message) -> None:
        """Sends it now."""


class Commands:
    """The commands of one link. reboot: called when a reboot was accepted."""

    def __init__(self, rover: Rover, link: AnsweringLink, reboot: Callable[[], None]) -> None:
        self.rover, self.link, self.reboot = rover, link, reboot
        self._known: dict[int, Callable[[Numbers], int]] = {
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_disarm,
            mavlink.MAV_CMD_DO_SET_MODE: lambda p: self.set_mode(int(p[0]), int(p[1]), GCS_COMMAND),
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
            mavlink.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: self._capabilities,
            mavlink.MAV_CMD_DO_AUX_FUNCTION: self._aux_function,
            mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: self._reboot,
            mavlink.MAV_CMD_SCRIPTING: self._scripting,
            mavlink.MAV_CMD_RUN_PREARM_CHECKS: self._prearm,
        }

    def run(self, command: int, numbers: Numbers) -> int:
        """Obeys a command with its seven numbers; the MAV_RESULT of the acknowledgement."""
        handler = self._known.get(command)
        return UNSUPPORTED if handler is None else handler(numbers)

    def set_mode(self, base_mode: int, custom_mode: int, reason: int) -> int:
        """DO_SET_MODE and SET_MODE: only custom modes."""
        if not base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return DENIED
        return ACCEPTED if self.rover.set_mode(custom_mode, reason) else FAILED

    def _arm_disarm(self, p: Numbers) -> int:
        if p[0] == 1:
            return ACCEPTED if self.rover.arm(forced=p[1] in FORCE_ARM) else FAILED
        if p[0] == 0:
            self.rover.disarm(forced=p[1] == FORCE_DISARM)
            return ACCEPTED
        return UNSUPPORTED

    def _set_interval(self, p: Numbers) -> int:
        message_id, interval_us = int(p[0]), int(p[1])
        if p[2] != 0:
            return DENIED
        schedule = self.link.schedule_of(message_id)
        if not schedule.known(message_id):
            self.rover.text(6, f"No ap_message for mavlink id ({message_id})")
            return DENIED
        result = schedule.request(message_id, interval_us)
        if result == DENIED:
            hint = "too fast. Increase SCHED_LOOP_RATE"
            self.rover.text(6, f"Requested rate for message ID {message_id} {hint}")
        return result

    def _get_interval(self, p: Numbers) -> int:
        message_id = int(p[0])
        schedule = self.link.schedule_of(message_id)
        known = schedule.known(message_id)
        interval_ms = schedule.interval_ms.get(message_id, 0)
        interval_us = (interval_ms * 1000 or -1) if known else 0
        self.link.send_message(mavlink.MAVLink_message_interval_message(message_id, interval_us))
        return ACCEPTED if known else FAILED

    def _request_message(self, p: Numbers) -> int:
        builder = BUILDERS.get(int(p[0]))
        if builder is None:
            return FAILED
        message = builder(self.rover)
        if message is not None:
            self.link.send_message(message)
        return ACCEPTED

    def _capabilities(self, p: Numbers) -> int:
        if p[0] != 1:
            return DENIED
        return self._request_message([mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION])

    def _aux_function(self, p: Numbers) -> int:
        if not 0 <= p[1] <= 2:
            return DENIED
        return ACCEPTED if self.rover.run_aux(int(p[0]), int(p[1])) else FAILED

    def _reboot(self, p: Numbers) -> int:
        if p[0] not in (1, 3):
            return UNSUPPORTED
        if self.rover.armed:
            return FAILED
        self.reboot()
        return ACCEPTED

    def _scripting(self, p: Numbers) -> int:
        if p[0] == SCRIPTING_RESTART:
            self.rover.scripts.restart()
        elif p[0] == SCRIPTING_STOP:
            self.rover.scripts.stop()
        else:
            return DENIED if p[0] in (0, 1) else UNSUPPORTED
        return ACCEPTED

    def _prearm(self, p: Numbers) -> int:
        return ACCEPTED if self.rover.run_prearm_checks() else TEMPORARILY_REJECTED
