"""Reads a .param file, and refuses a faulty one before the rover is contacted."""

from __future__ import annotations

import re
from pathlib import Path

from firmware_params.param_files import WantedParameter, read, shipped
from rover_sweep.errors import UsageError

_LONGEST = 16  # characters of a name in MAVLink
_LARGEST = 3.4e38  # of a float32
# Parameters that the vehicle writes, which an older file must not restore: counters (STAT_BOOTCNT shows
# reboots, see `setup.pending_reboot`), the air pressure at boot, sizes of stored lists (seen in 4.6.3).
_ITS_OWN = re.compile(
    r"STAT_(?!RESET$).*|BARO\d_GND_PRESS|SYS_NUM_RESETS|FORMAT_VERSION|(MIS|FENCE|RALLY)_TOTAL"
)


def written_by_vehicle(name: str) -> bool:
    """Whether the vehicle writes the parameter, so that it is neither compared nor set."""
    return _ITS_OWN.fullmatch(name) is not None


def wanted_of(file: str) -> tuple[WantedParameter, ...]:
    """The parameters of a file, or of a shipped one by its name (identification, raw_imu).

    Without those that a vehicle writes. UsageError if the file cannot be read, holds no parameter, or one
    that no vehicle can have.
    """
    path = Path(file)
    try:
        wanted = read(path if path.exists() else shipped(file))
    except UnicodeDecodeError:
        raise UsageError(
            f"{file} is not a parameter file: it is not text; give one with lines NAME VALUE"
        ) from None
    except OSError as error:
        raise UsageError(f"{file} cannot be read ({error.strerror}); give a .param file") from error
    except ValueError as error:
        words = str(error) if path.exists() else f"there is no file {file}, and {error}"
        raise UsageError(f"{words}; give a .param file with lines NAME VALUE") from error
    if not wanted:
        raise UsageError(f"{file} holds no parameter; give a .param file with lines NAME VALUE")
    for parameter in wanted:
        if len(parameter.name) > _LONGEST or not parameter.name.isascii():
            raise UsageError(
                f"{file}: {parameter.name} is not a parameter of ArduPilot, whose names have at most "
                f"{_LONGEST} characters"
            )
        if not abs(parameter.value) < _LARGEST:
            raise UsageError(
                f"{file}: {parameter.name} {parameter.value:g} is not a value that a rover can hold"
            )
    return tuple(parameter for parameter in wanted if not written_by_vehicle(parameter.name))
