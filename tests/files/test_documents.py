"""TOML and JSON that nobody writes are one sentence."""

from __future__ import annotations

import json
import time
import tomllib
from pathlib import Path

import pytest

from rover_sweep.data.vehicle_file import parse
from rover_sweep.errors import UsageError
from rover_sweep.files.documents import read_json, read_toml
from sitl.plant.variant import load_variant

LONG = "9" * 5000
HOSTILE_TOML = {
    "numeral": f"a = {LONG}",
    "float": f"a = {'9' * 400}",
    "brackets": f"a = {'[' * 100_000}",
    "lines of brackets": "a = " + "[\n" * 100_000,
    "keys": ".".join("a" * 100_000) + " = 1",
    "tables": "[" + ".".join("a" * 4000) + "]",
}


@pytest.mark.parametrize("text", HOSTILE_TOML.values(), ids=HOSTILE_TOML)
def test_hostile_toml_is_a_sentence_and_soon(text: str) -> None:
    begun = time.process_time()
    with pytest.raises(tomllib.TOMLDecodeError, match="digits|characters|brackets|Unclosed|Invalid value"):
        read_toml(text)
    assert time.process_time() - begun < 2.0


def test_of_a_variant_too(tmp_path: Path) -> None:
    path = tmp_path / "v.toml"
    path.write_text(HOSTILE_TOML["numeral"])
    with pytest.raises(ValueError, match="variant v.toml"):
        load_variant(path)


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000, LONG, "[" * 200 + "]" * 200])
def test_hostile_json_is_a_sentence(text: str) -> None:
    with pytest.raises(ValueError, match="digits|nested"):
        read_json(text)


def test_what_people_write_is_read_as_ever() -> None:
    assert read_toml("a = 1\n[b]\nc = [1.5, 2]") == {"a": 1, "b": {"c": [1.5, 2]}}
    nested = {"a": [{"b": [1, None, True, "x"]}]}
    assert read_json(json.dumps(nested)) == nested
    with pytest.raises(json.JSONDecodeError):
        read_json("{")


def test_the_vehicle_file_says_what_is_wrong_without_advice_to_programmers() -> None:
    with pytest.raises(UsageError) as raised:
        parse(f"[vehicle]\nmass = {LONG}")
    assert "has 5000 digits" in str(raised.value) and "sys." not in str(raised.value)
