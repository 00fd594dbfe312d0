"""Summary sentences from identification.json and diagnosis.json, whose keys are defined in `report`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rover_sweep.files.documents import read_json

_DOCUMENTS = {"identify": "identification.json", "diagnose": "diagnosis.json", "gains": "gains.json"}
_PAGES = {"identify": "report.html", "diagnose": "diagnosis.html", "gains": "gains.html"}


def page_of(kind: str, out: Path) -> Path | None:
    """The HTML report, None if it does not exist."""
    names = (_PAGES.get(kind, "report.html"), *(("speed.html",) if kind == "identify" else ()))
    return next((out / name for name in names if (out / name).is_file()), None)


def summary_of(kind: str, out: Path) -> tuple[str, ...]:
    """Sentences, the main result first; the error if the document cannot be read."""
    words = _words(out / _DOCUMENTS.get(kind, ""), kind)
    return words + _words(out / "speed.json", "speed") if kind == "identify" else words


def _words(path: Path, kind: str) -> tuple[str, ...]:
    """Sentences of one document, () without it."""
    if not path.is_file():
        return ()
    tell = {"identify": _identified, "diagnose": _diagnosed, "speed": _speed}.get(kind, _plain)
    try:
        return tuple(tell(read_json(path.read_text(encoding="utf-8"))))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        return (f"{path} cannot be read: {error}",)


def next_runs(out: Path) -> tuple[str, ...]:
    """Runs that a diagnosis proposes, one sentence per finding; () without a diagnosis."""
    try:
        found = read_json((out / _DOCUMENTS["diagnose"]).read_text(encoding="utf-8"))["findings"]
        return tuple(dict.fromkeys(f"{f['effect']}: {f['next_run']}" for f in found if f.get("next_run")))
    except (OSError, ValueError, KeyError, TypeError):
        return ()


def _identified(document: Mapping[str, Any]) -> Iterator[str]:
    summary = document.get("summary")
    yield from (summary,) if isinstance(summary, str) else tuple(summary or ())
    recommended = document.get("recommended")
    if numbers := document.get("numbers"):
        yield "numbers (90 % intervals): " + ", ".join(_parameter(n, v, True) for n, v in numbers.items())
    for name, model in sorted(document["models"].items(), key=lambda item: item[0] != recommended):
        best = name == recommended
        values = ", ".join(
            _parameter(parameter, value, best)
            for parameter, value in model["parameters"].items()
            if value.get("free") and value.get("value") is not None and "variant" not in value
        )
        yield f"{name}{' (recommended; 90 % intervals)' if best else ''}: {values or 'no free parameters'}"


def _parameter(name: str, estimate: Mapping[str, Any], interval: bool) -> str:
    low, high = (estimate.get("interval_90") if interval else None) or (None, None)
    between = f" ({low:.3g} to {high:.3g})" if low is not None and high is not None else ""
    return f"{name} {estimate['value']:.3g}{between} {estimate['unit']}".rstrip()


def _speed(document: Mapping[str, Any]) -> Iterator[str]:
    low, _, high = document["speeds_m_s"]
    why = f": {document['reasons'][0]}" if document["reasons"] else ""
    yield f"speed {low:.2f} to {high:.2f} m/s, {document['level']}{why}"
    if document["law"]:
        names = (
            ("gain", "gain_m_s", "m/s per full throttle"),
            ("lag", "lag_s", "s"),
            ("delay", "delay_s", "s"),
        )
        ends = document["intervals"]
        yield ", ".join(
            f"{name} {document['law'][key]:.3g} ({ends[name][0]:.3g} to {ends[name][1]:.3g}) {unit}"
            for name, key, unit in names
        )


def _diagnosed(document: Mapping[str, Any]) -> Iterator[str]:
    yield f"{document['verdict'].upper()}: {document['sentence']}"
    for finding in document["findings"]:
        turn = finding.get("turn") or ""
        worth = f"{finding.get('importance') or ''} {turn[:1].upper()}{turn[1:]}".strip()
        yield f"{finding['effect']}: {worth or finding['sentence']}"
        if finding.get("next_run"):
            yield f"drive next, for {finding['effect']}: {finding['next_run']}"


def _plain(document: Mapping[str, Any]) -> Iterator[str]:
    for key in ("sentence", "summary", "verdict"):
        if isinstance(text := document.get(key), str) and text:
            yield text
    yield from (str(text) for text in document.get("sentences") or ())
