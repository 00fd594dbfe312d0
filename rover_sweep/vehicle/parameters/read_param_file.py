"""A .param file as what is wanted of a rover: refused in words before a rover is asked anything."""

from __future__ import annotations

import re
from pathlib import Path

from firmware_params.param_files import WantedParameter, read, shipped
from rover_sweep.errors import UsageError

_LONGEST = 16  # letters: what MAVLink carries of a name
_LARGEST = 3.4e38  # of a float32
# What the vehicle writes itself, and what a file from another day must not put back: counters (STAT_BOOTCNT
# tells of reboots, see `pending`), the air pressure at boot, sizes of what is stored (seen in 4.6.3).
_ITS_OWN = re.compile(
    r"STAT_(?!RESET$).*|BARO\d_GND_PRESS|SYS_NUM_RESETS|FORMAT_VERSION|(MIS|FENCE|RALLY)_TOTAL"
)


def written_by_vehicle(name: str) -> bool:
    """Whether the vehicle keeps the parameter itself, so that it is neither compared nor set."""
    return _ITS_OWN.fullmatch(name) is not None


def wanted_of(file: str) -> tuple[WantedParameter, ...]:
    """The parameters of a file, or of one that comes with the program by its name (identification, raw_imu).

    Without those that a vehicle keeps by itself. UsageError where it cannot be read, holds none, or one that
    no vehicle could have.
    """
    path = Path(file)
    try:
        wanted = read(path if path.exists() else shipped(file))
    except UnicodeDecodeError:
        raise UsageError(
            f"{file} is no parameter file: it is not text; give one with lines NAME VALUE"
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
                f"{file}: {parameter.name} is no parameter of ArduPilot, whose names have at most "
                f"{_LONGEST} characters"
            )
        if not abs(parameter.value) < _LARGEST:
            raise UsageError(
                f"{file}: {parameter.name} {parameter.value:g} is no value that a rover can hold"
            )
    return tuple(parameter for parameter in wanted if not written_by_vehicle(parameter.name))
