"""Client of a server with OpenAI's chat API: cloud, vLLM, Ollama, llama.cpp. The only file that speaks HTTP.

One call of `complete` is one request: the library's own retries are off, because `Caller` retries by error type. The
reply is read here from its raw bytes, so that a cut body, HTML with status 200 or an error inside a 200 become errors
of our tree. The key is read from the environment when a connection is opened; the object, its repr, its pickle and its
errors do not hold it.
"""

from __future__ import annotations

import asyncio
import base64
import io
import json
import os
import re
import time
import weakref
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC
from email.utils import parsedate_to_datetime
from typing import Any

import aiohttp
import httpx2
import openai
from PIL import Image

from pipeline.models.config import EndpointConfig, ImageConfig
from pipeline.models.messages import ImagePart, Message, Reply, Request
from pipeline.models.reply_schemas import messages_sent, response_format
from schemas.errors import (
    InputError,
    LostReplyError,
    QuestionError,
    RateLimitError,
    RetryError,
    SplatReasonerError,
    StopError,
    UnreachableError,
)

_UNIT_S = {"h": 3600.0, "m": 60.0, "s": 1.0, "ms": 1e-3, "": 1.0}
_DURATION = re.compile(r"(\d+(\.\d+)?(h|ms|m|s))*(\d+(\.\d+)?)?")

TEXT_LIMIT = 300
"""Characters of a server's message kept in an error."""

UNSENT = (
    aiohttp.ClientConnectorError,
    aiohttp.ConnectionTimeoutError,
    aiohttp.ClientHttpProxyError,
    aiohttp.InvalidURL,
)
"""What ends a request before its first byte: a name that does not resolve, a refused connection, a handshake that fails
or takes too long, a proxy that lets nothing through."""

STOP_STATUS = frozenset({401, 402, 403, 404, 405, 407, 410})
"""Bad key, no money, no right, no such model or address: the next request would fail alike."""
RETRY_STATUS = frozenset({408, 409, 425, 429})
"""Client errors that pass; every 5xx does too."""
STOP_CODES = frozenset({"insufficient_quota", "billing_hard_limit_reached", "invalid_api_key", "model_not_found"})
"""Error codes that end a run whatever status they come with: an exhausted quota is sent as 429."""


@dataclass(frozen=True, slots=True)
class _Connection:
    """What belongs to one event loop: sockets and locks cannot move to another."""

    client: openai.AsyncOpenAI
    slots: asyncio.Semaphore


class EndpointClient:
    """A `ChatClient` for one endpoint. May be pickled and used from several event loops, one after another.

    Args:
        name: The endpoint's name in the job file.
        config: Address, model and parameters.

    Raises:
        InputError: `key_env` names a variable that is not set.
    """

    def __init__(self, name: str, config: EndpointConfig) -> None:
        self._endpoint, self._config, self._identity = name, config, config.identity()
        self._connections: weakref.WeakKeyDictionary[asyncio.AbstractEventLoop, _Connection]
        self._connections = weakref.WeakKeyDictionary()
        self._key()

    @property
    def name(self) -> str:
        """Endpoint and model, as rows record it."""
        return f"{self._endpoint}:{self._config.model}"

    def identity(self) -> Mapping[str, Any]:
        """Return what changes a reply; timeouts, concurrency and the key's variable do not."""
        return self._identity

    def messages_sent(self, request: Request) -> tuple[Message, ...]:
        """Return the messages as the endpoint gets them."""
        return messages_sent(request, self._config.structured)

    async def complete(self, request: Request) -> Reply:
        """Send one request and return the reply.

        Raises:
            RateLimitError: Status 429, or another that passes with a Retry-After.
            UnreachableError: No connection came about; nothing was sent.
            LostReplyError: Timeout, deadline, connection lost, a body that is no chat reply.
            RetryError: 5xx and the client errors that pass.
            QuestionError: The request is too long, malformed or refused.
            StopError: Bad key, no quota, unknown model or address, or no such `structured` output there.
        """
        connection = self._connect()
        # Encoding pictures takes milliseconds, filling in text less than handing it to a thread.
        body = await asyncio.to_thread(self._body, request) if request.images() else self._body(request)
        try:
            async with connection.slots, asyncio.timeout(self._config.deadline_s):
                # The library's documented way to reach any path: `create` would also check and transform the body,
                # which costs half as much again as sending it, and parse the reply, which is ours to do.
                response = await connection.client.post("/chat/completions", cast_to=httpx2.Response, body=body)
        except openai.APIStatusError as error:
            raise self._status_error(error, request) from None
        except TimeoutError:
            raise LostReplyError(f"{self.name}: no reply within {self._config.deadline_s:g} s") from None
        except openai.APIConnectionError as error:
            raise self._connection_error(error) from None
        except (openai.OpenAIError, aiohttp.ClientError) as error:  # the library passes on what is no HTTP as it is
            raise LostReplyError(self._clean(f"unusable reply: {error}")) from None
        return self._read(response.content)

    async def aclose(self) -> None:
        """Close the connections of the running event loop."""
        connection = self._connections.pop(asyncio.get_running_loop(), None)
        if connection is not None:
            await connection.client.close()

    def __repr__(self) -> str:
        return f"EndpointClient({self.name!r})"

    def __getstate__(self) -> tuple[str, EndpointConfig]:
        return self._endpoint, self._config

    def __setstate__(self, state: tuple[str, EndpointConfig]) -> None:
        self.__init__(*state)  # type: ignore[misc]

    def _key(self) -> str:
        variable = self._config.key_env
        key = os.environ.get(variable, "").strip() if variable else "none"
        if not key:
            expected = f"the API key of endpoint {self._endpoint!r}"
            raise InputError(f"environment variable {variable}", expected=expected, found="nothing")
        return key

    def _connect(self) -> _Connection:
        loop = asyncio.get_running_loop()
        connection = self._connections.get(loop)
        if connection is None:
            timeout = openai.Timeout(
                self._config.deadline_s, connect=self._config.connect_timeout_s, read=self._config.read_timeout_s
            )
            most = self._config.concurrency
            # Of the library's two transports the one that takes half the CPU time, and no more with many connections.
            sockets = openai.DefaultAioHttpClient(
                limits=httpx2.Limits(max_connections=most, max_keepalive_connections=most), timeout=timeout
            )
            client = openai.AsyncOpenAI(
                api_key=self._key(),
                base_url=self._config.base_url,
                max_retries=0,
                timeout=timeout,
                http_client=sockets,
            )
            connection = self._connections[loop] = _Connection(client, asyncio.Semaphore(self._config.concurrency))
        return connection

    def _body(self, request: Request) -> dict[str, Any]:
        config = self._config
        body: dict[str, Any] = {
            "model": config.model,
            "messages": [
                {"role": message.role, "content": _content(message.parts, config.images)}
                for message in self.messages_sent(request)
            ],
            "response_format": response_format(request, config.structured),
            "temperature": config.temperature,
            "top_p": config.top_p,
            config.max_tokens_field: config.max_tokens,
            "seed": None if config.seed is None else config.seed + config.repeat,
        }
        return {field: value for field, value in body.items() if value is not None} | config.extra_body

    def _read(self, content: bytes) -> Reply:
        try:
            data = json.loads(content)
        except (ValueError, RecursionError):
            raise LostReplyError(self._clean(f"the reply is no JSON: {content[:80]!r}")) from None
        error = data.get("error") if isinstance(data, dict) else None
        if error:
            code = error.get("code") if isinstance(error, dict) else None
            status = code if isinstance(code, int) else 500
            raise self._classify(status, code, _message(error), None)
        try:
            choice = data["choices"][0]
            message, finish = choice["message"], choice.get("finish_reason")
            text = _text(message.get("content"))
            usage = data.get("usage") or {}
            tokens = [int(usage.get(field) or 0) for field in ("prompt_tokens", "completion_tokens")]
            model = _text(data.get("model") or self._config.model)
        except (KeyError, IndexError, TypeError, AttributeError, ValueError):
            raise LostReplyError(self._clean(f"the reply is no chat completion: {content[:80]!r}")) from None
        if message.get("refusal"):
            raise QuestionError(self._clean(f"refused: {message['refusal']}"))
        if finish == "content_filter":
            raise QuestionError(self._clean("refused by the server's content filter"))
        return Reply(text, tokens[0], tokens[1], model)

    def _connection_error(self, error: openai.APIConnectionError) -> RetryError:
        """The transport's own error tells one case from another: a hang-up reaches us as a timeout to connect."""
        cause: BaseException = error
        while not isinstance(cause, aiohttp.ClientError | OSError) and cause.__cause__ is not None:
            cause = cause.__cause__
        if isinstance(cause, UNSENT):
            return UnreachableError(self._clean(f"no connection, nothing was sent: {cause}"))
        if isinstance(cause, TimeoutError):
            return LostReplyError(f"{self.name}: no reply in time (read timeout {self._config.read_timeout_s:g} s)")
        return LostReplyError(self._clean(f"connection lost before the whole reply was there: {cause}"))

    def _status_error(self, error: openai.APIStatusError, request: Request) -> SplatReasonerError:
        message = _message(error.body) or error.message
        structured = self._config.structured
        if structured != "none" and error.status_code in (400, 422) and _names_form(error.param, message, request):
            remedy = f"set structured of endpoint {self._endpoint!r} to json_object or none"
            return StopError(self._clean(f"the server takes no response_format {structured}: {remedy}. {message}"))
        return self._classify(error.status_code, error.code, message, _retry_after_s(error.response.headers))

    def _classify(self, status: int, code: object, message: str, retry_after_s: float | None) -> SplatReasonerError:
        text = self._clean(f"HTTP {status}: {message}")
        if code in STOP_CODES or status in STOP_STATUS:
            return StopError(text)
        if status < 500 and status not in RETRY_STATUS:
            return QuestionError(text)
        if status == 429 or retry_after_s is not None:
            return RateLimitError(text, retry_after_s)
        return RetryError(text)

    def _clean(self, text: str) -> str:
        """Servers repeat the key in their messages at times."""
        key = os.environ.get(self._config.key_env or "", "").strip()
        text = " ".join(text.split())
        text = text.replace(key, "***") if key else text
        return f"{self.name}: {text[:TEXT_LIMIT]}"


def _names_form(param: str | None, message: str, request: Request) -> bool:
    """Return whether a refusal is about the form asked for. A server that repeats a question's words is not heard."""
    texts = (part for turn in request.messages for part in turn.parts if isinstance(part, str))
    said = "response_format" in message and not any("response_format" in text for text in texts)
    return said or (param or "").startswith("response_format")


def _content(parts: tuple[str | ImagePart, ...], images: ImageConfig) -> str | list[dict[str, Any]]:
    """Plain text where there is no image: some servers take lists of parts from vision models only."""
    if all(isinstance(part, str) for part in parts):
        return "".join(part for part in parts if isinstance(part, str))
    return [
        {"type": "text", "text": part}
        if isinstance(part, str)
        else {"type": "image_url", "image_url": _url(part, images)}
        for part in parts
    ]


def _url(part: ImagePart, config: ImageConfig) -> dict[str, str]:
    image = Image.fromarray(part.color)
    if max(image.size) > config.side:
        image.thumbnail((config.side, config.side), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    if config.format == "png":
        image.save(buffer, "PNG")
    else:
        image.save(buffer, "JPEG", quality=config.jpeg_quality)
    url = {"url": f"data:image/{config.format};base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"}
    return url | ({"detail": config.detail} if config.detail else {})


def _text(content: object) -> str:
    """Servers send null, a text, or a list of parts. Half a surrogate pair, which no table can hold, becomes "?"."""
    if isinstance(content, list):
        content = "".join(str(part["text"]) for part in content if part.get("type") == "text")
    if not isinstance(content, str | None):
        raise TypeError("content is neither text nor parts")
    return (content or "").encode("utf-8", "replace").decode("utf-8")


def _message(body: object) -> str:
    if isinstance(body, Mapping):
        inner = body.get("error", body)
        return str(inner.get("message") or inner) if isinstance(inner, Mapping) else str(inner)
    return str(body) if body else ""


def _retry_after_s(headers: Mapping[str, str]) -> float | None:
    """Return the wait a server asked for: milliseconds, seconds, or an HTTP date measured by the server's own clock."""
    for header, scale in (("retry-after-ms", 1e-3), ("retry-after", 1.0)):
        try:
            seconds = float(headers.get(header, "")) * scale
        except ValueError:
            continue
        if 0 <= seconds < float("inf"):
            return seconds
    until = _http_date(headers.get("retry-after", ""))
    if until is None:
        return _reset_s(headers)
    now = _http_date(headers.get("date", ""))
    return max(0.0, until - (time.time() if now is None else now))


def _reset_s(headers: Mapping[str, str]) -> float | None:
    """Return the wait until what is used up is there again, by OpenAI's rate-limit headers, such as "1m3.5s"."""
    waits = []
    for kind in ("requests", "tokens"):
        reset = headers.get(f"x-ratelimit-reset-{kind}", "")
        if headers.get(f"x-ratelimit-remaining-{kind}") == "0" and _DURATION.fullmatch(reset) and reset:
            parts = re.findall(r"([\d.]+)([a-z]*)", reset)
            waits.append(sum(float(number) * _UNIT_S[unit] for number, unit in parts))
    return max(waits, default=None)


def _http_date(text: str) -> float | None:
    try:
        date = parsedate_to_datetime(text)
    except ValueError:
        return None
    return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
