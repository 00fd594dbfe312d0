"""Stop signals in a row: one raises, the others must not end what it began."""

from __future__ import annotations

import signal
import threading

import pytest

from rover_sweep import system
from rover_sweep.system import another_stop, hold_stops, one_stop

pytestmark = pytest.mark.usefixtures("interrupting")


@pytest.fixture
def interrupting():
    """SIGTERM acts as Ctrl-C, as while a session is shown."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    yield
    assert signal.getsignal(signal.SIGTERM) == signal.default_int_handler  # it was put back
    signal.signal(signal.SIGTERM, before)


def pressed(times: int = 1) -> None:
    for number in (signal.SIGTERM, signal.SIGINT) * times:
        signal.raise_signal(number)


def test_those_on_the_heels_of_one_do_not_raise() -> None:
    with one_stop() as came:
        assert not came()
        with pytest.raises(KeyboardInterrupt):
            pressed()
        pressed(3)
        assert came()
    with pytest.raises(KeyboardInterrupt):
        pressed()


def test_one_that_was_swallowed_leaves_the_next_its_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    """As by a destructor, in which Python drops an exception."""
    with one_stop():
        with pytest.raises(KeyboardInterrupt):
            pressed()
        monkeypatch.setattr(system, "_ON_ITS_WAY", 0.0)
        with pytest.raises(KeyboardInterrupt):
            pressed()


def test_a_release_is_ended_only_where_it_allows_it() -> None:
    with one_stop(), one_stop():  # of a session and of a run in it
        hold_stops()
        pressed(3)
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt), another_stop():
                pressed()
            pressed(3)
        with another_stop():
            pass
        pressed()


def test_another_thread_changes_nothing() -> None:
    def work() -> None:
        with one_stop() as came, another_stop():
            hold_stops()
            assert not came()

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    with pytest.raises(KeyboardInterrupt):
        pressed()
