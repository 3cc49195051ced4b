"""Locks of the models of engines, and processes that are forked off while one is held.

A child process has only the thread that forked it. A step of another thread would never end there,
and its model would stay as a step has it for a while. So a fork waits until no model is held.
"""

from __future__ import annotations

import os
import weakref

from dashpot import _core

_locks: weakref.WeakSet[_core.ModelLock] = weakref.WeakSet()
_held_by_fork: list[_core.ModelLock] = []


def new_lock() -> _core.ModelLock:
    """Return the lock of a new engine's model."""
    lock = _core.ModelLock()
    _locks.add(lock)
    return lock


def _hold_all() -> None:
    for lock in list(_locks):
        try:
            lock.lock_with_line()
        except RuntimeError:  # this thread has it: it forks from a callback of its step
            continue
        _held_by_fork.append(lock)


def _release_all() -> None:
    while _held_by_fork:
        _held_by_fork.pop().unlock_with_line()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_hold_all, after_in_parent=_release_all, after_in_child=_release_all)
