"""Screens look the same on every machine: no serial ports are plugged in."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def no_ports(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rover_sweep.tui.session_app.serial_ports", lambda: {"/dev/ttyACM0,115200": ""})
