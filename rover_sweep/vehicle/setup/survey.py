"""What a rover has of what identification needs: parameters, and the applet."""

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
    """A wanted parameter and what the rover has; found is None where it has none."""

    wanted: WantedParameter
    found: float | None

    @property
    def fits(self) -> bool:
        return self.wanted.met_by(self.found)


@dataclass(frozen=True)
class AppletState:
    """file: on the rover, None where it cannot be read. lacking: SWP_ parameters that are not there.

    enabled: SWP_ENABLE is 1. current: the file is, to the letter, the one of this program.
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
        """A file that cannot be read is believed if the applet runs."""
        return self.runs and self.enabled and (self.current or self.file is None)

    @property
    def sentence(self) -> str:
        """What is to be said of it."""
        mine = version_of(applet_source())
        if len(self.lacking) == len(PARAMETERS):
            there = f"{self.file.path} is there but does not run" if self.file else "it is not there"
            return f"the applet does not run: {there}"
        if self.lacking:
            return f"an applet of another version runs: no {', '.join(self.lacking)}"
        if not self.enabled:
            return "the applet is switched off: SWP_ENABLE is 0"
        if self.file is None:
            return "the applet runs; its version cannot be read (no MAVLink FTP, or under another name)"
        if not self.current:
            other = self.file.version or "none"
            how = f"version {other}, not {mine}" if other != mine else f"version {mine}, but changed"
            return f"{self.file.path} is another applet than this program's ({how})"
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
    """Reads; changes nothing. LinkError for anything but an ArduPilot Rover."""
    vehicle = identify_vehicle(link)
    has = read_present(link, [*(p.name for p in wanted), *(p.name for p in PARAMETERS)])
    file = read_applet(link, applet_path().name, applet_source())
    lacking = tuple(p.name for p in PARAMETERS if p.name not in has)
    current = file is not None and file.text == applet_source()
    applet = AppletState(file, lacking, has.get("SWP_ENABLE") == 1, current)
    return Survey(vehicle, tuple(SurveyedParameter(p, has.get(p.name)) for p in wanted), applet)
