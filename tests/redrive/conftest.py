"""The truth of the recordings as a variant of the plant: linear tyres, a servo without rate limit."""

from __future__ import annotations

from pathlib import Path

import pytest

TRUTH = 'base = "nominal"\nfriction = 4.0\nservo_rate_limit = 40.0\n'


@pytest.fixture(scope="session")
def truth(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("variant") / "truth.toml"
    path.write_text(TRUTH)
    return path
