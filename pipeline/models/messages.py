"""The chat protocol: what a stage asks and what comes back, whoever answers."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int32, UInt8

Stage = Literal[
    "evidence",
    "view_answer",
    "choice",
    "verify",
    "answer_one",
    "answer_many",
    "judge",
    "caption",
    "answer_text",
    "answer_blind",
]
"""answer_one is the EQA / single-target prompt (one image index), answer_many asks yes or no per image. Baselines alone
ask caption, answer_text (from descriptions) and answer_blind (from nothing)."""


HASH_SHOWN = 16
"""Digits of a picture's hash in the text of a request: 64 bits tell a run's pictures apart."""


@dataclass(frozen=True, slots=True)
class Observation:
    """What a view shows besides its colours: the input of the offline `symbolic` model, and of nothing else.

    It is rendered from the scene's stored categories and depth; it holds no instance, answer or position in
    the world.
    """

    category: Int32[np.ndarray, "H W"]
    """Category id of the dominant Gaussian per pixel, -1 unlabelled or empty."""
    depth: Float[np.ndarray, "H W"]
    """z-depth in metres, 0 where nothing is."""
    K: Float[np.ndarray, "3 3"]
    """Intrinsics of this image, pixels."""
    up: Float[np.ndarray, "3"]
    """Unit vector opposite to gravity in camera axes."""
    vocabulary: tuple[str, ...]
    """Names of the category ids."""


@dataclass(frozen=True, slots=True)
class ImagePart:
    """An image in a message."""

    color: UInt8[np.ndarray, "H W 3"]
    """sRGB pixels."""
    observation: Observation | None = None
    """For the symbolic model; never sent to an endpoint."""
    _digest: str = field(default="", init=False, repr=False, compare=False)
    """The hash once it was made."""

    def __reduce__(self) -> tuple[type[ImagePart], tuple[Any, ...]]:
        # Arrays that were pickled may be written to again, so what is known of them is not.
        return ImagePart, (self.color, self.observation)

    def sha256(self) -> str:
        """Return the hash of the pixels and, where there is one, of the observation.

        It is made once, at 0.6 ms for 320 x 240 pixels, and holds from then on: the arrays can no longer be written
        to, and a view of memory that can is copied first.
        """
        if not self._digest:
            self._freeze()
            digest = hashlib.sha256(repr(self.color.shape).encode())
            digest.update(np.ascontiguousarray(self.color).data)
            if self.observation is not None:
                for name in _ARRAYS:
                    digest.update(np.ascontiguousarray(getattr(self.observation, name)).data)
                digest.update("\n".join(self.observation.vocabulary).encode())
            object.__setattr__(self, "_digest", digest.hexdigest())
        return self._digest

    def _freeze(self) -> None:
        object.__setattr__(self, "color", _frozen(self.color))
        if (seen := self.observation) is not None:
            arrays = {name: _frozen(getattr(seen, name)) for name in _ARRAYS}
            object.__setattr__(self, "observation", Observation(**arrays, vocabulary=seen.vocabulary))


_ARRAYS = ("category", "depth", "K", "up")
"""Arrays of an observation in the order in which they are hashed."""


def _frozen(array: np.ndarray) -> np.ndarray:
    """Return an array that is no longer written to: itself, or a copy of one whose memory belongs to another."""
    owner = array.base
    while isinstance(owner, np.ndarray) and not owner.flags.writeable:
        owner = owner.base
    if owner is not None:
        array = array.copy()
    array.flags.writeable = False
    return array


@dataclass(frozen=True, slots=True)
class Message:
    """One chat message: text and images in order."""

    role: Literal["system", "user", "assistant"]
    """Who speaks."""
    parts: tuple[str | ImagePart, ...]
    """Text and images, in the order the model reads them."""


def text_of(messages: Sequence[Message]) -> str:
    """Return messages as a person reads them: a line `=== role ===` before each, `[image HASH]` for a picture.

    The hash is the beginning of `ImagePart.sha256`, so equal texts are equal messages. A message of text alone stands
    as it is sent; in one with pictures every part begins a line.
    """
    return "\n".join(f"=== {message.role} ===\n{_parts_text(message.parts)}" for message in messages)


def _parts_text(parts: Sequence[str | ImagePart]) -> str:
    texts = [part if isinstance(part, str) else f"[image {part.sha256()[:HASH_SHOWN]}]" for part in parts]
    return ("" if all(isinstance(part, str) for part in parts) else "\n").join(texts)


@dataclass(frozen=True, slots=True)
class Request:
    """One model call before it is sent."""

    stage: Stage
    """Which stage asks."""
    messages: tuple[Message, ...]
    """The prompt, filled in."""
    variables: Mapping[str, Any] = field(default_factory=dict)
    """What filled the prompt: question, categories, candidates, k. The symbolic model reads these, so that a
    user's own prompt wording does not change it."""

    def images(self) -> Sequence[ImagePart]:
        """Return the images in order."""
        return [part for message in self.messages for part in message.parts if isinstance(part, ImagePart)]


@dataclass(frozen=True, slots=True)
class Reply:
    """What a model returned."""

    text: str
    """The reply."""
    prompt_tokens: int = 0
    """Tokens in, as the server counts them."""
    completion_tokens: int = 0
    """Tokens out."""
    model: str = ""
    """Model the server says it used."""


@runtime_checkable
class ChatClient(Protocol):
    """Anything that answers a request: an endpoint, the symbolic model, a fake in a test."""

    @property
    def name(self) -> str:
        """Endpoint and model, as rows record it."""
        ...

    def identity(self) -> Mapping[str, Any]:
        """Return all that changes an answer besides the messages: endpoint, model, parameters. Enters the cache key."""
        ...

    async def complete(self, request: Request) -> Reply:
        """Return the reply.

        Raises:
            RetryError: It may succeed later (RateLimitError with the wait the server asked for).
            QuestionError: This request will never succeed (refused, too long).
            StopError: No request will succeed (bad key, unknown model).
        """
        ...
