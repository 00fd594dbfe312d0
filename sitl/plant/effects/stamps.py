"""Streams that are stamped by another clock."""

from __future__ import annotations

from collections.abc import Mapping

from sitl.plant.effects_table import STREAMS, Effects, number

RECORDS = {"steering": ("SWEP", "RCOU", "RCIN"), "velocity": ("XKF1",)}
"""DataFlash messages of each stream."""


def late_records(effects: Effects) -> Mapping[str, int]:
    """DataFlash message -> microseconds that its stamps are late by; nothing where the clocks agree.

    A positive T stamps the stream late by T: the motion then appears early against a late steering.
    """
    stream = str(effects.get("clock_offset", {}).get("stream", STREAMS[0]))
    late = round(1e6 * number(effects, "clock_offset", "T"))
    return dict.fromkeys(RECORDS[stream], late) if late else {}
