"""Whether a rover has the parameters and the applet that identification needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from firmware_params.applet_parameters import PARAMETERS, applet_path, applet_source
from firmware_params.param_files import WantedParameter
from rover_sweep.vehicle.identity import VehicleIdentity, identify_vehicle
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.parameters.read_write import read_present
from rover_sweep.vehicle.setup.applet_upload import AppletFile, read_applet, version_of


@dataclass(frozen=True)
class SurveyedParameter:
    """A wanted parameter and the rover's value; found is None if the rover does not have it."""

    wanted: WantedParameter
    found: float | None

    @property
    def fits(self) -> bool:
        return self.wanted.met_by(self.found)


@dataclass(frozen=True)
class AppletState:
    """file: on the rover, None if it cannot be read. lacking: SWP_ parameters that the rover does not have.

    enabled: SWP_ENABLE is 1. current: the file is identical to this program's.
    """

    file: AppletFile | None
    lacking: tuple[str, ...]
    enabled: bool
    current: bool

    @property
    def runs(self) -> bool:
        """Whether an applet with this program's parameters runs."""
        return not self.lacking

    @property
    def fits(self) -> bool:
        """Whether this program's applet runs, enabled; a file that cannot be read is not a fault."""
        return self.runs and self.enabled and (self.current or self.file is None)

    @property
    def sentence(self) -> str:
        """The state in one sentence."""
        mine = version_of(applet_source())
        if len(self.lacking) == len(PARAMETERS):
            why = f"{self.file.path} exists but does not run" if self.file else "its file is not on the rover"
            return f"the applet does not run: {why}"
        if self.lacking:
            return f"another version of the applet runs: it has no {', '.join(self.lacking)}"
        if not self.enabled:
            return "the applet is switched off: SWP_ENABLE is 0"
        if self.file is None:
            return "the applet runs; its version cannot be read (no MAVLink FTP, or under another name)"
        if not self.current:
            other = self.file.version or "none"
            how = f"version {other}, not {mine}" if other != mine else f"version {mine}, but changed"
            return f"{self.file.path} is not this program's applet ({how})"
        return f"applet {mine} runs ({self.file.path})"


@dataclass(frozen=True)
class Survey:
    """A rover against a list of wanted parameters and this program's applet."""

    vehicle: VehicleIdentity
    parameters: tuple[SurveyedParameter, ...]
    applet: AppletState

    @property
    def fits(self) -> bool:
        return self.applet.fits and all(p.fits for p in self.parameters)


def survey(link: Link, wanted: Sequence[WantedParameter]) -> Survey:
    """Compare the rover with the wanted parameters and the applet; changes nothing. LinkError for anything
    but an ArduPilot Rover."""
    vehicle = identify_vehicle(link)
    has = read_present(link, [*(p.name for p in wanted), *(p.name for p in PARAMETERS)])
    file = read_applet(link, applet_path().name, applet_source())
    lacking = tuple(p.name for p in PARAMETERS if p.name not in has)
    current = file is not None and file.text == applet_source()
    applet = AppletState(file, lacking, has.get("SWP_ENABLE") == 1, current)
    return Survey(vehicle, tuple(SurveyedParameter(p, has.get(p.name)) for p in wanted), applet)
