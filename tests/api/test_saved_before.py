"""Files that `Result.save` wrote before the modules moved are still read: each class, field and function."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from rover_sweep.api.save import _found, _function

SAVED = json.loads((Path(__file__).parents[1] / "data/saved_classes.json").read_text())


@pytest.mark.parametrize("address", SAVED["classes"])
def test_a_class_is_found_with_its_fields(address: str) -> None:
    found = _found(address)
    assert set(SAVED["classes"][address]) <= {f.name for f in dataclasses.fields(found) if f.init}


@pytest.mark.parametrize("address", SAVED["functions"])
def test_a_function_that_builds_a_model_is_found(address: str) -> None:
    assert callable(_function(address))
