"""The one place where a stage's model call is sent: cache, retries, asking again, and a row for all that happened.

A stage hands over its variables, images and parser; clients only carry a request. Failures that may pass are tried
again here and nowhere else.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

from pipeline.models.cache import CallCache, GroupedPuts, NewReply, call_key
from pipeline.models.estimate import Price, TokenEstimate
from pipeline.models.gate import Gate
from pipeline.models.messages import ChatClient, ImagePart, Message, Reply, Request, Stage, text_of
from pipeline.models.prompts import Prompts
from pipeline.models.retry import RetryPolicy, spread_of
from schemas.calls import CallRow
from schemas.errors import (
    InputError,
    LostReplyError,
    QuestionError,
    RateLimitError,
    RetryError,
    SplatReasonerError,
    UnreachableError,
)
from schemas.questions import Question

T = TypeVar("T")

_ROW_STAGE: Mapping[Stage, str] = dict.fromkeys(("answer_one", "answer_many", "answer_text", "answer_blind"), "answer")
"""The answer prompts are one stage of the method."""


CLAIMED_S = 0.2
"""Seconds until it is looked again whether another run that asks the same just now has ended."""
LONGEST_CLAIM_S = 600.0
"""Seconds after which it is not waited for any longer: its process may hang."""
LAST_WORDS_S = 5.0
"""Seconds in which the gates of a caller that is closed may say what its last calls cost."""


@runtime_checkable
class Closing(Protocol):
    """A client that holds connections."""

    async def aclose(self) -> None:
        """Close those of the running event loop."""
        ...


@runtime_checkable
class Adding(Protocol):
    """A client that adds words of its own to a request."""

    def messages_sent(self, request: Request) -> tuple[Message, ...]:
        """Return the messages as they are sent."""
        ...


@dataclass(frozen=True, slots=True)
class Asked(Generic[T]):
    """What became of a question put to a model."""

    value: T | None
    """The reply as the parser read it; None when no reply could be read."""
    text: str
    """The last reply as it came."""
    rows: tuple[CallRow, ...]
    """One row for everything sent or found, in order."""


def rows_of(error: BaseException) -> tuple[CallRow, ...]:
    """Return the calls made before a `Caller.ask` ended in this error; () for an error from elsewhere."""
    rows = getattr(error, "call_rows", ())
    return rows if isinstance(rows, tuple) else ()


@dataclass(frozen=True, slots=True)
class Toll:
    """What stands between a call and its endpoint."""

    gate: Gate | None
    """Where it waits its turn; None: nowhere."""
    estimate: TokenEstimate
    """What it may use."""
    price: Price | None
    """What tokens cost; None where nobody said."""


class _Flight:
    """A request under way: the same request asked meanwhile waits for it instead of being paid for again."""

    def __init__(self) -> None:
        self.landed = asyncio.Event()
        self.reply: Reply | None = None


class Caller:
    """Sends the calls of all stages. For one event loop at a time; not for several threads.

    Args:
        clients: Who answers each stage.
        prompts: Wording.
        cache: Stored replies; None to store and find nothing.
        max_asks: Times a stage is asked before its reply counts as unreadable, at least 1.
        retry: What is done about failures that may pass.
        uncached: Stages whose replies are not worth storing, such as those of the symbolic model.
        tolls: By endpoint, what its calls pass before they are sent.
        replay: Whether stored replies are all there is: a call that is not in the cache fails, and nothing is sent.
        keep_prompts: Whether rows hold the text of their requests.
        sleep: Waits a number of seconds.
        clock: Monotonic seconds, to measure latency.
    """

    def __init__(
        self,
        clients: Mapping[Stage, ChatClient],
        prompts: Prompts,
        cache: CallCache | None,
        *,
        max_asks: int = 2,
        retry: RetryPolicy | None = None,
        uncached: Collection[Stage] = (),
        tolls: Mapping[str, Toll] | None = None,
        replay: bool = False,
        keep_prompts: bool = True,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if max_asks < 1:
            raise InputError("models", field="max_asks", expected="1 or more", found=max_asks)
        self.clients, self.prompts, self.cache, self.max_asks = clients, prompts, cache, max_asks
        self.retry = retry or RetryPolicy()
        self.uncached = frozenset(uncached)
        self.tolls, self.replay, self.keep_prompts = dict(tolls or {}), replay, keep_prompts
        self._sleep, self._clock = sleep, clock
        self._flights: dict[str, _Flight] = {}
        self._puts: GroupedPuts | None = None

    async def ask(
        self,
        stage: Stage,
        variables: Mapping[str, Any],
        images: Sequence[ImagePart],
        parse: Callable[[str], T | None],
        *,
        question: Question,
        subject: str = "",
    ) -> Asked[T]:
        """Ask a stage's model and read its reply.

        Args:
            stage: Which prompt and which client.
            variables: Values of the prompt's placeholders.
            images: Pictures in order.
            parse: Reads a reply; None when it cannot be read. Then the model is asked again, told what is expected.
            question: Whom the rows belong to.
            subject: What the call is about: a candidate id, a cluster, an arm.

        Returns:
            The value, or None with the last reply when it stayed unreadable after `max_asks`.

        Raises:
            RetryError: Every try failed for a reason that may pass.
            QuestionError: This request cannot succeed.
            StopError: No request can succeed.
            InputError: A variable is missing. `rows_of(error)` holds the calls made until any of these.
        """
        client = self.clients[stage]
        log = _Log(
            question,
            _ROW_STAGE.get(stage, stage),
            subject,
            client.name,
            self.prompts.sha256(self.prompts.template_name(stage, variables)),
        )
        try:
            request = self.prompts.fill(stage, variables, images)
            while True:
                log.attempt += 1
                log.key = call_key(client.identity(), request)
                if self.keep_prompts:
                    sent_as = client.messages_sent(request) if isinstance(client, Adding) else request.messages
                    log.prompt = text_of(sent_as)
                sent = await self._reply(client, request, log)
                reply = sent.reply
                value = parse(reply.text)
                log.add("unparsed" if value is None else "ok", sent)
                if value is not None or log.attempt >= self.max_asks:
                    return Asked(value, reply.text, tuple(log.rows))
                request = self.prompts.ask_again(request, reply.text)
        except SplatReasonerError as error:
            error.call_rows = tuple(log.rows)  # type: ignore[attr-defined]
            raise

    async def aclose(self) -> None:
        """Close connections, after the gates know what every call cost."""
        gates = [toll.gate for toll in self.tolls.values() if toll.gate is not None]
        # A gate whose admission is gone would tell it for ever; the journal counts what it lacks as spent.
        with suppress(TimeoutError):
            async with asyncio.timeout(LAST_WORDS_S):
                await asyncio.gather(*(gate.settled() for gate in gates))
        for client in {id(client): client for client in self.clients.values()}.values():
            if isinstance(client, Closing):
                await client.aclose()
        if self.cache is not None:
            await asyncio.to_thread(self.cache.close)

    async def _reply(self, client: ChatClient, request: Request, log: _Log) -> _Sent:
        """Return a reply that was paid for now, or that cost nothing: stored, or under way for someone else."""
        cache = None if request.stage in self.uncached else self.cache
        while (flight := self._flights.get(log.key)) is not None:
            await flight.landed.wait()
            if flight.reply is not None:
                return _Sent(flight.reply, cached=True)
        flight = self._flights[log.key] = _Flight()
        try:
            stored = cache.get(log.key) if cache is not None else None
            if stored is not None:
                flight.reply = stored
                return _Sent(stored, cached=True)
            if self.replay and request.stage not in self.uncached:
                missing = QuestionError(f"replay: no reply is stored for the {request.stage} call {log.key}")
                log.add("QuestionError", _Sent(Reply(str(missing))))
                raise missing
            sent = await self._send(client, request, log, cache)
            flight.reply = sent.reply
            return sent
        finally:
            del self._flights[log.key]
            flight.landed.set()

    async def _send(self, client: ChatClient, request: Request, log: _Log, cache: CallCache | None) -> _Sent:
        tries = 0
        while True:
            tries += 1
            try:
                return await self._try(client, request, log.key, cache)
            except _FailedTry as failed:
                error = failed.error
                log.add(type(error).__name__, failed.sent)
                if not isinstance(error, RetryError):
                    raise error from None
                wait_s = self.retry.wait_s(tries, error, spread=spread_of(log.key, tries))
                if wait_s is None:
                    raise error from None
                await self._sleep(wait_s)

    async def _try(self, client: ChatClient, request: Request, key: str, cache: CallCache | None) -> _Sent:
        """Send a request once, when its endpoint's gate lets it, and store its reply.

        The gate hears of the end only after that: a call with the same key that waits there, in whatever process,
        then finds the reply. Another run's waits for the claim.
        """
        toll = self.tolls.get(client.name.partition(":")[0])
        if toll is None or toll.gate is None:
            sent = await self._timed(client, request, 0.0, toll)
            await self._store(client, request, key, cache, sent.reply)
            return sent
        start = self._clock()
        while True:
            ticket = await toll.gate.enter(*toll.estimate.most(request), "" if cache is None else key)
            # Within a run equal calls wait at the gate; the claim is for other runs that share the folder.
            if cache is None or cache.claim(key) or self._clock() - start > LONGEST_CLAIM_S:
                break
            toll.gate.leave(ticket, 0, sent=False)
            await self._sleep(CLAIMED_S)
            while not cache.claim(key) and self._clock() - start <= LONGEST_CLAIM_S:
                await self._sleep(CLAIMED_S)
            cache.unclaim(key)  # it is not held in the queue
        wait_s = self._clock() - start
        try:
            stored = cache.get(key) if cache is not None else None
            if stored is not None:
                toll.gate.leave(ticket, 0, sent=False)
                return _Sent(stored, cached=True)
            sent = await self._timed(client, request, wait_s, toll)
            await self._store(client, request, key, cache, sent.reply)
        except _FailedTry as failed:
            limit = isinstance(failed.error, RateLimitError)
            pause_s = failed.error.retry_after_s if isinstance(failed.error, RateLimitError) else None
            tokens = None if isinstance(failed.error, LostReplyError) else 0
            went = not isinstance(failed.error, UnreachableError)
            toll.gate.leave(ticket, tokens, overloaded=limit, pause_s=pause_s, sent=went)
            raise
        except BaseException:
            toll.gate.leave(ticket, None)
            raise
        finally:
            if cache is not None:
                cache.unclaim(key)
        used = sent.reply.prompt_tokens + sent.reply.completion_tokens
        toll.gate.leave(ticket, used or None, sent.usd or 0.0)
        return sent

    async def _store(
        self, client: ChatClient, request: Request, key: str, cache: CallCache | None, reply: Reply
    ) -> None:
        # A blank reply is mostly a server's hiccup: it counts as unreadable now, and is not held for ever.
        if cache is not None and reply.text.strip():
            if self._puts is None:
                self._puts = GroupedPuts(cache)
            await self._puts.put(NewReply(key, reply, request.stage, client.name))

    async def _timed(self, client: ChatClient, request: Request, wait_s: float, toll: Toll | None) -> _Sent:
        start = self._clock()
        try:
            reply = await client.complete(request)
        except SplatReasonerError as error:
            failure = _Sent(Reply(str(error)), self._clock() - start, wait_s)
            raise _FailedTry(error, failure) from None
        usd = None
        if toll is not None:
            toll.estimate.learn(request, reply)
            if toll.price is not None:
                usd = toll.price.of(reply.prompt_tokens, reply.completion_tokens)
        return _Sent(reply, self._clock() - start, wait_s, usd)


@dataclass(frozen=True, slots=True)
class _Sent:
    """A reply and what it took."""

    reply: Reply
    latency_s: float = 0.0
    wait_s: float = 0.0
    usd: float | None = 0.0
    cached: bool = False


class _FailedTry(Exception):
    """One send that failed."""

    def __init__(self, error: SplatReasonerError, sent: _Sent) -> None:
        super().__init__(str(error))
        self.error, self.sent = error, sent


class _Log:
    """The rows of one `ask`."""

    def __init__(self, question: Question, stage: str, subject: str, client: str, prompt_sha256: str) -> None:
        self.question, self.stage, self.subject, self.prompt_sha256 = question, stage, subject, prompt_sha256
        self.endpoint, _, model = client.partition(":")
        self.model = model or client
        self.attempt, self.key, self.prompt = 0, "", ""
        self.rows: list[CallRow] = []

    def add(self, outcome: str, sent: _Sent) -> None:
        reply = sent.reply
        self.rows.append(
            CallRow(
                question_id=self.question.question_id,
                scene=self.question.scene,
                stage=self.stage,
                subject=self.subject,
                key=self.key,
                endpoint=self.endpoint,
                model=reply.model or self.model,
                prompt_sha256=self.prompt_sha256,
                attempt=self.attempt,
                outcome=outcome,
                reply=reply.text,
                prompt_tokens=reply.prompt_tokens,
                completion_tokens=reply.completion_tokens,
                wait_s=sent.wait_s,
                latency_s=sent.latency_s,
                usd=sent.usd,
                cached=sent.cached,
                prompt=self.prompt,
            )
        )
