"""Buffers that frames share: fresh memory costs a page fault per page, which is a tenth of a frame."""

from __future__ import annotations

from threading import local

import numpy as np
from jaxtyping import Shaped, UInt8

_GROWTH = 1.25
"""Spare room of a new buffer, so that views of similar size do not each ask for a larger one."""
_LINE = 64
"""Arrays start on a cache line, so that a 64-byte record is one line and not two."""


class Workspace(local):
    """Named scratch arrays of one thread, kept from frame to frame; what they hold between uses is undefined."""

    def __init__(self) -> None:
        self._buffers: dict[str, UInt8[np.ndarray, "bytes"]] = {}

    def array(self, name: str, size: int, dtype: type[np.generic]) -> Shaped[np.ndarray, "size"]:
        """Return a one-dimensional array of `size` elements; it is the same memory until more is asked for."""
        needed = size * np.dtype(dtype).itemsize
        if name not in self._buffers or self._buffers[name].nbytes < needed + _LINE:
            self._buffers[name] = np.empty(int(needed * _GROWTH) + _LINE, np.uint8)
        buffer = self._buffers[name]
        start = -buffer.ctypes.data % _LINE
        return buffer[start : start + needed].view(dtype)

    def lend(self, *names: str) -> dict[str, UInt8[np.ndarray, "bytes"]]:
        """Hand over the memory of these arrays: views of it stay valid until it is given back."""
        return {name: self._buffers.pop(name) for name in names if name in self._buffers}

    def give_back(self, lent: dict[str, UInt8[np.ndarray, "bytes"]]) -> None:
        """Take memory back for later arrays of the same names."""
        for name, buffer in lent.items():
            if name not in self._buffers or self._buffers[name].nbytes < buffer.nbytes:
                self._buffers[name] = buffer

    def clear(self) -> None:
        """Give this thread's memory back."""
        self._buffers.clear()

    def fill(self, byte: int) -> None:
        """Overwrite every buffer: nothing may depend on what an earlier frame left."""
        for buffer in self._buffers.values():
            buffer[:] = byte


WORKSPACE = Workspace()
"""The scratch memory of whichever thread asks."""
