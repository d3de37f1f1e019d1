"""One driver a run folder: every session takes the next epoch, and a driver whose epoch is not the latest is out.

driver/<epoch>.json   who took it; made only where nothing is, so of two drivers at once one gets it; never removed
driver/<epoch>.beat   a counter that its driver raises while it lives, and whether it has ended

A driver counts as gone when its process on this machine is gone, or when its counter stands still for a while. That
while is measured by the looker's own clock, one that only grows: what time of day a machine believes it is decides
nothing. A driver that was merely asleep finds the later epoch before it commits anything more, and stops.
"""

from __future__ import annotations

import dataclasses
import json
import os
import socket
import threading
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from schemas import storage
from schemas.errors import InputError, SplatReasonerError, StopError

FOLDER = "driver"
BEAT_S = 5.0
"""Seconds between beats."""
ABANDONED_S = 60.0
"""Stillness after which a driver counts as gone: many beats, so a slow disk does not look dead."""
GLANCE_S = 1.5 * BEAT_S
"""How long `driver_alive` watches a driver that it cannot ask the kernel about: a beat falls into it."""
LOOK_S = 0.5
"""Seconds between two looks at another driver's counter."""

_let_go: set[str] = set()
"""Owners of this process that have ended: a full disk may keep them from saying so on it."""


class FencedError(StopError):
    """Another driver has taken the run: this one must not write to it any more."""


@dataclass(frozen=True, slots=True)
class Holder:
    """A driver, as its claim names it."""

    epoch: int
    """Sessions of the run so far, this one included."""
    owner: str
    """Unlike that of any other session."""
    host: str
    """Machine it runs on."""
    space: str
    """Boot and process-id space its `pid` belongs to: two containers may share a host's name."""
    pid: int
    """Process id."""
    started: str
    """When the process began, in the kernel's ticks: ids are used again, start times are not."""

    def __str__(self) -> str:
        """Return who it is, in words."""
        return f"process {self.pid} on {self.host}"


class RunLock:
    """Holds a run folder for this process, as a context manager.

    Args:
        run: Run folder, a path or URI.
        told: Called with a text when entering takes a while, since a driver that may be gone is watched.

    Raises:
        StopError: On entry: another driver is at work.
    """

    def __init__(self, run: str, told: Callable[[str], None] = lambda text: None) -> None:
        self._run, self._told = run, told
        self._owner = uuid.uuid4().hex
        self._holder: Holder | None = None
        self._beats = 0
        self._ended, self._lost = threading.Event(), threading.Event()
        self._beating = threading.Thread(target=self._keep_beating, name="run-lock", daemon=True)

    @property
    def epoch(self) -> int:
        """Number of this session; grows with each."""
        assert self._holder is not None, "a lock has an epoch once it is entered"
        return self._holder.epoch

    @property
    def next_claim(self) -> str:
        """Path or URI of the file by which another driver takes the run from this one."""
        return _claim(self._run, self.epoch + 1)

    @property
    def lost(self) -> bool:
        """Whether a beat found that another driver has taken the run; looks at nothing itself."""
        return self._lost.is_set()

    def check(self) -> None:
        """Look whether the run is still this driver's, which nothing may be committed without.

        Raises:
            FencedError: Another driver has taken it.
        """
        if not self.lost and not storage.exists(self.next_claim):
            return
        self._lost.set()
        latest = read_holder(self._run)
        raise FencedError(
            f"{self._run}: {latest or 'another driver'} took this run over, since this driver (session {self.epoch}) "
            "showed no life for a while; it has stopped and written nothing since. What it had committed counts"
        )

    def __enter__(self) -> RunLock:
        latest = read_holder(self._run)
        if latest is not None and not self._gone(latest):
            raise StopError(f"{self._run}: another driver is at work on this run ({latest}); stop it first")
        pid = os.getpid()
        epoch = (0 if latest is None else latest.epoch) + 1
        holder = Holder(epoch, self._owner, socket.gethostname(), _space(), pid, _process(pid).started)
        if not storage.create_bytes(_claim(self._run, epoch), json.dumps(dataclasses.asdict(holder)).encode()):
            raise StopError(f"{self._run}: another driver began at the same moment; try again")
        self._holder = holder
        self._beat()
        self._beating.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._ended.set()
        self._beating.join()
        _let_go.add(self._owner)
        self._beat(ended=True)

    def _gone(self, holder: Holder) -> bool:
        """Return whether a driver is gone, after watching it where that cannot be known at once."""
        alive = _known_alive(self._run, holder)
        if alive is not None:
            return not alive
        self._told(f"waiting up to {ABANDONED_S:g} s to see whether {holder} is still at work on this run")
        return not _beats_within(self._run, holder, ABANDONED_S)

    def _keep_beating(self) -> None:
        while not self._ended.wait(BEAT_S):
            self._beat()
            try:
                if storage.exists(self.next_claim):
                    self._lost.set()
            except SplatReasonerError:
                # A store that does not answer says nothing about who holds the run; `check` asks again.
                continue

    def _beat(self, *, ended: bool = False) -> None:
        self._beats += 1
        # A beat that cannot be written, on a full disk for one, ends no run: at worst others take this driver for
        # dead, and then it finds itself fenced out.
        try:
            text = json.dumps({"beat": self._beats, "ended": ended})
            storage.write_bytes_atomic(_pulse(self._run, self.epoch), text.encode())
        except SplatReasonerError:
            return


def read_holder(run: str) -> Holder | None:
    """Return the driver that took a run last, at work or not; None when there was none."""
    names = storage.list_files(storage.join(run, FOLDER))
    epochs = [int(name.removesuffix(".json")) for name in names if name.removesuffix(".json").isdecimal()]
    if not epochs:
        return None
    uri = _claim(run, max(epochs))
    try:
        found = Holder(**json.loads(storage.read_bytes(uri)))
    except (ValueError, TypeError, InputError):
        # A damaged claim still took its epoch; whoever made it shows life by its beats or not at all.
        return Holder(max(epochs), "", "an unknown machine", "", 0, "")
    return dataclasses.replace(found, epoch=max(epochs))


def driver_alive(run: str) -> bool:
    """Return whether a driver is at work on a run.

    A driver of this machine is looked up; one elsewhere, or asleep, is watched for a beat and a half.
    """
    holder = read_holder(run)
    if holder is None:
        return False
    alive = _known_alive(run, holder)
    return _beats_within(run, holder, GLANCE_S) if alive is None else alive


def _beats_within(run: str, holder: Holder, seconds: float) -> bool:
    """Watch a driver's counter until it moves, its driver says that it ended, or the time is over."""
    until = time.monotonic() + seconds
    first, ended = _read_pulse(run, holder.epoch)
    now = first
    while now == first and not ended and (left := until - time.monotonic()) > 0:
        time.sleep(min(LOOK_S, left))
        now, ended = _read_pulse(run, holder.epoch)
    return now != first and not ended


def _read_pulse(run: str, epoch: int) -> tuple[int, bool]:
    """Return a driver's counter, 0 before its first beat, and whether it has ended."""
    uri = _pulse(run, epoch)
    try:
        found = json.loads(storage.read_bytes(uri)) if storage.exists(uri) else {}
        return int(found.get("beat", 0)), bool(found.get("ended", False))
    except (InputError, ValueError, AttributeError):
        return 0, False


def _known_alive(run: str, holder: Holder) -> bool | None:
    """Return whether a driver is at work; None where it is asleep or elsewhere, so that only its beats can tell."""
    if holder.owner in _let_go or _read_pulse(run, holder.epoch)[1]:
        return False
    if (holder.host, holder.space) != (socket.gethostname(), _space()):
        return None
    process = _process(holder.pid)
    if process.started != holder.started or not process.started:
        return False
    return None if process.asleep else True


@dataclass(frozen=True, slots=True)
class _Process:
    started: str
    asleep: bool


def _process(pid: int) -> _Process:
    """Return what the kernel says of a process; nothing of one that has ended."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return _Process("", False)
    state, *rest = text.rpartition(")")[2].split()
    # A killed process stays as a zombie until its parent looks; it does no more work.
    return _Process("" if state in "ZX" else rest[18], state in "Tt")


def _space() -> str:
    """Return what tells apart places where the same process id means different processes."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        return f"{boot} {os.stat('/proc/self/ns/pid').st_ino}"
    except OSError:
        return ""


def _claim(run: str, epoch: int) -> str:
    return storage.join(run, FOLDER, f"{epoch:06d}.json")


def _pulse(run: str, epoch: int) -> str:
    return storage.join(run, FOLDER, f"{epoch:06d}.beat")
