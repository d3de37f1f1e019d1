"""What stands in for an endpoint when a run is replayed from stored replies: it is never asked and needs no key."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline.models.config import EndpointConfig
from pipeline.models.messages import Message, Reply, Request
from pipeline.models.reply_schemas import messages_sent
from schemas.errors import StopError


class OfflineClient:
    """A `ChatClient` with the name and identity of an endpoint.

    Args:
        name: The endpoint's name in the job file.
        config: The endpoint.
    """

    def __init__(self, name: str, config: EndpointConfig) -> None:
        self._endpoint, self._config = name, config

    @property
    def name(self) -> str:
        """Endpoint and model, as rows record it."""
        return f"{self._endpoint}:{self._config.model}"

    def identity(self) -> Mapping[str, Any]:
        """Return the endpoint's identity."""
        return self._config.identity()

    def messages_sent(self, request: Request) -> tuple[Message, ...]:
        """Return the messages as the endpoint got them."""
        return messages_sent(request, self._config.structured)

    async def complete(self, request: Request) -> Reply:
        """Send nothing.

        Raises:
            StopError: Always.
        """
        raise StopError(f"{self.name}: nothing is sent in a replay ({request.stage} call)")
