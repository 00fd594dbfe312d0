"""The numbers of the rover. An exported file has those of its variant here."""

from __future__ import annotations

from sitl.plant.variant import load_variant

PARAMETERS = load_variant("nominal")
