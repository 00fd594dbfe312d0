"""The ground on the command line: 60x20, length and width in metres."""

from __future__ import annotations

import re

import click

_FORM = re.compile(r"([0-9]+\.?[0-9]*)x([0-9]+\.?[0-9]*)")


class GroundType(click.ParamType):
    """LENGTHxWIDTH in metres, the length in the direction of the drive."""

    name = "LENGTHxWIDTH"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float]:
        """(length, width) [m]."""
        if isinstance(value, tuple):
            return float(value[0]), float(value[1])
        found = _FORM.fullmatch(str(value).strip())
        if not found or not (0 < float(found[1]) <= 1e5 and 0 < float(found[2]) <= 1e5):
            self.fail(f"{value!r} is not a ground; write it as 60x20, length and width in m", param, ctx)
        return float(found[1]), float(found[2])
