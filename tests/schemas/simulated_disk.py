"""A disk in memory that loses power, kept to what POSIX promises and no more.

A file's content outlasts a power cut once it was synced, a name once its folder was. Of everything else any part may
have reached the disk: each name separately, in any of its states since the last sync, and of a file's content nothing,
all of it, a beginning, or zeros of the right length.
"""

from __future__ import annotations

import random
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from schemas.local_files import Disk


class PowerCut(BaseException):
    """The machine stopped; nothing can catch it by accident."""


@dataclass
class Inode:
    data: bytes
    synced: bytes = b""


FOLDER = Inode(b"folder")


class SimulatedDisk(Disk):
    def __init__(self, *folders: Path) -> None:
        self.names: dict[Path, Inode | None] = {Path("/"): FOLDER, **dict.fromkeys(folders, FOLDER)}
        self.past: dict[Path, list[Inode | None]] = {}
        """States of a name since its folder was synced, the durable one first."""
        self.touches = 0
        self.cut_at: int | None = None
        self.turn: Callable[[], None] = lambda: None
        """Called before every touch; a scheduler lets another thread go on here."""

    def _touch(self) -> None:
        self.turn()
        self.touches += 1
        if self.cut_at is not None and self.touches > self.cut_at:
            raise PowerCut

    def _set(self, path: Path, inode: Inode | None) -> None:
        self.past.setdefault(path, [self.names.get(path)])
        self.past[path].append(inode)
        self.names[path] = inode

    def _inode(self, path: Path) -> Inode:
        found = self.names.get(path)
        if found is None or found is FOLDER:
            raise FileNotFoundError(2, "No such file", str(path))
        return found

    def read(self, path: Path) -> bytes:
        self.turn()
        return self._inode(path).data

    def exists(self, path: Path) -> bool:
        self.turn()
        return self.names.get(path) is not None

    def files(self, folder: Path, recursive: bool) -> list[str]:
        """A listing is no single moment: others may go on between one name and the next."""
        found = []
        for path in sorted(self.names):
            if path.parent == folder or (recursive and folder in path.parents):
                self.turn()
                if self.names[path] not in (None, FOLDER):
                    found.append(path.relative_to(folder).as_posix())
        return found

    def make_folder(self, path: Path) -> None:
        self._touch()
        assert self.names.get(path.parent) is FOLDER
        if self.names.get(path) is None:
            self._set(path, FOLDER)

    def write(self, path: Path, data: bytes) -> None:
        self._touch()
        if self.names.get(path.parent) is not FOLDER:
            raise FileNotFoundError(2, "No such folder", str(path.parent))
        self._set(path, Inode(data))

    def sync(self, path: Path) -> None:
        self._touch()
        inode = self.names.get(path)
        if inode is None:
            raise FileNotFoundError(2, "No such file", str(path))
        if inode is not FOLDER:
            inode.synced = inode.data
            return
        for name in [name for name in self.past if name.parent == path]:
            del self.past[name]

    def replace(self, path: Path, target: Path) -> None:
        self._touch()
        self._set(target, self._inode(path))
        self._set(path, None)

    def link(self, path: Path, target: Path) -> None:
        self._touch()
        if self.names.get(target) is not None:
            raise FileExistsError(17, "File exists", str(target))
        self._set(target, self._inode(path))

    def unlink(self, path: Path) -> None:
        self._touch()
        if self.names.get(path) is not None:
            self._set(path, None)

    def reboot(self, chance: random.Random, *, power: bool) -> None:
        """Come back after a power cut, or after the process alone was killed."""
        if power:
            for path, states in self.past.items():
                self.names[path] = chance.choice(states)
            for inode in {id(i): i for i in self.names.values() if i not in (None, FOLDER)}.values():
                assert inode is not None
                if inode.synced != inode.data:
                    beginning = inode.data[: chance.randrange(len(inode.data) + 1)]
                    inode.data = chance.choice([inode.synced, inode.data, beginning, bytes(len(inode.data))])
                inode.synced = inode.data
            self.past = {}
            for path in sorted(self.names):
                if path != path.parent and self.names.get(path.parent) is not FOLDER:
                    self.names[path] = None
        self.cut_at = None


class Turns:
    """Runs functions in threads of which one at a time goes on, from one touch of the disk to the next."""

    def __init__(self, disk: SimulatedDisk, chance: random.Random) -> None:
        self._chance, self._turns = chance, dict[int, threading.Semaphore]()
        self._back = threading.Semaphore(0)
        disk.turn = self._wait

    def _wait(self) -> None:
        mine = self._turns.get(threading.get_ident())
        if mine is not None:
            self._back.release()
            mine.acquire()

    def run(self, *functions: Callable[[], None]) -> None:
        errors, ended = list[BaseException](), set[int]()

        def start(function: Callable[[], None]) -> None:
            self._turns[threading.get_ident()] = threading.Semaphore(0)
            self._wait()
            try:
                function()
            except BaseException as error:
                errors.append(error)
            ended.add(threading.get_ident())
            self._back.release()

        threads = [threading.Thread(target=start, args=(function,), daemon=True) for function in functions]
        for thread in threads:
            thread.start()
            self._back.acquire()
        while waiting := [number for number in self._turns if number not in ended]:
            number = self._chance.choice(waiting)
            # Now and then one sleeps while the others do a lot.
            for _ in range(self._chance.choice((1, 1, 3, 30, 200))):
                if number not in ended:
                    self._turns[number].release()
                    self._back.acquire()
        for thread in threads:
            thread.join()
        self._turns.clear()
        if errors:
            raise errors[0]
