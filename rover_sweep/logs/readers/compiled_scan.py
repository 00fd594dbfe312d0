"""The scan of a large DataFlash log, compiled by numba: the way from message to message.

Only logs from `dataflash_index.LARGE` bytes load this file: below, the import of numba takes longer than
the scan. The compiled code is kept on disk, so that only the first run on a machine pays.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from numba import njit

compiled: Any = njit(cache=True, nogil=True)


@compiled
def _is_head(data, lengths, at):  # type: ignore[no-untyped-def]
    return at < data.size - 2 and data[at] == 0xA3 and data[at + 1] == 0x95 and lengths[data[at + 2]] > 0


@compiled
def follow(data, lengths, at, until, end, kinds, jumps, landings):  # type: ignore[no-untyped-def]
    """The messages that start in [at, until), as `dataflash_index.messages_of` defines them.

    end: where the message before ends. Writes their types to kinds (m,), and for each message that does not
    start where the one before ends its index to jumps and its offset to landings. Returns (number of
    messages, number of jumps, where to search on, end of the last message).
    """
    n = j = 0
    size = data.size
    last = min(until, size - 2)
    while at < last:
        x = at
        while x < size - 2:
            if _is_head(data, lengths, x):
                follower = x + lengths[data[x + 2]]
                if follower == size or _is_head(data, lengths, follower):
                    break
            x += 1
        if x >= size - 2:
            return n, j, size, end
        if x >= until:
            return n, j, x, end
        if x != end:
            jumps[j] = n
            landings[j] = x
            j += 1
        while True:  # as long as each message is followed by one
            kind = data[x + 2]
            kinds[n] = kind
            n += 1
            at = end = x + lengths[kind]
            if at >= last or data[at] != 0xA3 or data[at + 1] != 0x95:
                break
            kind = data[at + 2]
            follower = at + lengths[kind]
            if lengths[kind] == 0 or follower >= size - 2:
                break
            if data[follower] != 0xA3 or data[follower + 1] != 0x95 or lengths[data[follower + 2]] == 0:
                break
            x = at
    return n, j, at, end


def say_when_compiling(kernel: Any, of_what: str) -> None:
    """One line on stderr before the only run that compiles `kernel`."""
    try:
        index = Path(kernel._cache._cache_file._index_path)
    except AttributeError:  # another version of numba: no line
        return
    if not index.is_file():
        print(
            f"compiling the reader of {of_what}, once on this machine (seconds; kept in {index.parent})",
            file=sys.stderr,
        )
