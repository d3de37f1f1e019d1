"""The chat protocol: what a stage asks and what comes back, whoever answers."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int32, UInt8

Stage = Literal["evidence", "view_answer", "choice", "verify", "answer_one", "answer_many", "judge", "caption"]
"""answer_one is the EQA / single-target prompt (one image index), answer_many asks yes or no per image; caption is
asked by baselines alone."""


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

    def sha256(self) -> str:
        """Return the hash of the pixels and, where there is one, of the observation."""
        digest = hashlib.sha256(repr(self.color.shape).encode())
        digest.update(np.ascontiguousarray(self.color).data)
        if self.observation is not None:
            for array in (self.observation.category, self.observation.depth, self.observation.K, self.observation.up):
                digest.update(np.ascontiguousarray(array).data)
            digest.update("\n".join(self.observation.vocabulary).encode())
        return digest.hexdigest()


@dataclass(frozen=True, slots=True)
class Message:
    """One chat message: text and images in order."""

    role: Literal["system", "user", "assistant"]
    """Who speaks."""
    parts: tuple[str | ImagePart, ...]
    """Text and images, in the order the model reads them."""


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
