"""The endpoint client against a real local server: each way it fails, the request's form, and where the key goes."""

from __future__ import annotations

import asyncio
import base64
import io
import json
import pickle
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from email.utils import formatdate
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pipeline.models.caller import Caller
from pipeline.models.config import EndpointConfig
from pipeline.models.endpoint import EndpointClient
from pipeline.models.messages import ImagePart, Message, Reply, Request
from pipeline.models.prompts import Prompts
from schemas.errors import (
    InputError,
    LostReplyError,
    QuestionError,
    RateLimitError,
    RetryError,
    StopError,
    UnreachableError,
)
from schemas.questions import Question

KEY = "sk-very-secret-1234"
TEXT = Request("choice", (Message("system", ("Be brief.",)), Message("user", ("Which?",))))


def completion(content: Any = "1", **message: Any) -> dict[str, Any]:
    choice = {"index": 0, "finish_reason": "stop", "message": {"role": "assistant", "content": content, **message}}
    usage = {"prompt_tokens": 11, "completion_tokens": 2, "total_tokens": 13}
    return {"id": "x", "object": "chat.completion", "model": "m-2026", "choices": [choice], "usage": usage}


class Server(ThreadingHTTPServer):
    """Answers every request with what the test put in `respond`, and keeps the requests."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.bodies: list[dict[str, Any]] = []
        self.headers: list[dict[str, str]] = []
        self.under_way, self.most_under_way, self.lock = 0, 0, threading.Lock()
        self.respond: Callable[[Handler], None] = lambda handler: handler.send(200, completion())

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that hangs up is part of the tests."""


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Server

    def do_POST(self) -> None:
        with self.server.lock:
            self.server.under_way += 1
            self.server.most_under_way = max(self.server.most_under_way, self.server.under_way)
        self.server.bodies.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        self.server.headers.append({name.lower(): value for name, value in self.headers.items()})
        try:
            self.server.respond(self)
        finally:
            with self.server.lock:
                self.server.under_way -= 1

    def send(self, status: int, body: Any, *, length: int | None = None, **headers: str) -> None:
        content = body if isinstance(body, bytes) else json.dumps(body).encode()
        self.send_response(status)
        self.send_header("Content-Length", str(len(content) if length is None else length))
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()
        self.wfile.write(content)
        self.wfile.flush()
        if length is not None:
            self.close_connection = True

    def log_message(self, format: str, *args: Any) -> None:
        """Tests print nothing."""


@pytest.fixture
def server() -> Iterator[Server]:
    server = Server()
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield server
    server.shutdown()
    thread.join()
    server.server_close()


def _client(server: Server | str, **options: Any) -> EndpointClient:
    address = server if isinstance(server, str) else f"http://127.0.0.1:{server.server_port}/v1"
    return EndpointClient("gpt", EndpointConfig(kind="openai", base_url=address, model="m", **options))


def _complete(client: EndpointClient, *requests: Request) -> list[Reply]:
    async def run() -> list[Reply]:
        try:
            return list(await asyncio.gather(*(client.complete(request) for request in requests or (TEXT,))))
        finally:
            await client.aclose()

    return asyncio.run(run())


def _error(body: Any = "", code: str | None = None) -> dict[str, Any]:
    return {"error": {"message": body, "type": "x", "code": code}}


def test_complete_returns_text_tokens_and_the_model_that_answered(server: Server) -> None:
    assert _complete(_client(server)) == [Reply("1", 11, 2, "m-2026")]


def test_complete_sends_parameters_and_leaves_out_what_is_null(server: Server) -> None:
    _complete(_client(server, seed=7, extra_body={"reasoning_effort": "low"}))
    _complete(_client(server, temperature=None, max_tokens=50, max_tokens_field="max_completion_tokens"))
    assert server.bodies[0] == {
        "model": "m",
        "messages": [{"role": "system", "content": "Be brief."}, {"role": "user", "content": "Which?"}],
        "temperature": 0.0,
        "max_tokens": 1024,
        "seed": 7,
        "reasoning_effort": "low",
    }
    assert set(server.bodies[1]) == {"model", "messages", "max_completion_tokens"}


@pytest.mark.parametrize("structured", ["none", "json_object"])
def test_complete_sends_the_text_that_rows_keep(server: Server, structured: str) -> None:
    variables = {"question": "Which lamp?", "candidates": ["a", "b"]}
    server.respond = lambda handler: handler.send(200, completion("0"))

    async def run() -> str:
        caller = Caller({"choice": _client(server, structured=structured)}, Prompts.load(), None)
        question = Question("q1", "flat", "eqa", "Which lamp?")
        asked = await caller.ask("choice", variables, (), int, question=question)
        await caller.aclose()
        return asked.rows[0].prompt

    kept = asyncio.run(run())
    assert kept == "\n".join(f"=== {m['role']} ===\n{m['content']}" for m in server.bodies[0]["messages"])
    assert ("JSON object" in kept) == (structured != "none")


def test_complete_sends_another_seed_in_each_repetition_and_none_where_there_is_none(server: Server) -> None:
    _complete(_client(server, seed=7, repeat=2))
    _complete(_client(server, repeat=2))
    assert [body.get("seed") for body in server.bodies] == [9, None]


@pytest.mark.parametrize("form", ["png", "jpeg"])
def test_complete_sends_images_as_data_uris_of_bounded_side(server: Server, form: str) -> None:
    color = np.zeros((60, 200, 3), np.uint8)
    color[:, 100:] = 250
    parts = ("Look:", "Image 0", ImagePart(color), "Image 1", ImagePart(color[:40, :50]))
    client = _client(server, images={"side": 100, "format": form, "detail": "low"})
    _complete(client, Request("answer_one", (Message("user", parts),)))
    content = server.bodies[0]["messages"][0]["content"]
    assert [c["type"] for c in content] == ["text", "text", "image_url", "text", "image_url"]
    sizes = []
    for index in (2, 4):
        assert content[index]["image_url"]["detail"] == "low"
        start, data = content[index]["image_url"]["url"].split(",")
        assert start == f"data:image/{form};base64"
        image = Image.open(io.BytesIO(base64.b64decode(data)))
        assert image.format == form.upper()
        sizes.append(image.size)
        pixels = np.asarray(image)
    assert sizes == [(100, 30), (50, 40)]
    assert np.abs(pixels.astype(int) - color[:40, :50]).max() <= (0 if form == "png" else 3)


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (None, ""),
        ("", ""),
        ("grün 青", "grün 青"),
        ("half \ud83d a pair", "half ? a pair"),
        ([{"type": "text", "text": "a"}, {"type": "x"}, {"type": "text", "text": "b"}], "ab"),
    ],
)
def test_complete_reads_every_form_of_content(server: Server, content: Any, text: str) -> None:
    server.respond = lambda handler: handler.send(200, completion(content))
    assert _complete(_client(server))[0].text == text


def test_complete_without_usage_counts_no_tokens(server: Server) -> None:
    body = {"choices": completion()["choices"]}
    server.respond = lambda handler: handler.send(200, body)
    assert _complete(_client(server)) == [Reply("1", 0, 0, "m")]


STATUS = [
    (400, None, QuestionError),
    (413, None, QuestionError),
    (415, None, QuestionError),
    (422, None, QuestionError),
    (400, "context_length_exceeded", QuestionError),
    (400, "model_not_found", StopError),
    (401, None, StopError),
    (402, None, StopError),
    (403, None, StopError),
    (404, None, StopError),
    (405, None, StopError),
    (429, "insufficient_quota", StopError),
    (408, None, RetryError),
    (409, None, RetryError),
    (429, None, RateLimitError),
    (500, None, RetryError),
    (502, None, RetryError),
    (503, None, RetryError),
    (529, None, RetryError),
]


@pytest.mark.parametrize(("status", "code", "expected"), STATUS)
def test_complete_status_becomes_an_error_of_our_tree(
    server: Server, status: int, code: str | None, expected: type[Exception]
) -> None:
    server.respond = lambda handler: handler.send(status, _error("what went wrong", code))
    with pytest.raises(expected, match=f"gpt:m: HTTP {status}: .*what went wrong") as caught:
        _complete(_client(server))
    assert type(caught.value) is expected
    assert caught.value.__cause__ is None
    assert len(server.bodies) == 1, "the library retried by itself"


@pytest.mark.parametrize("body", [b"", b"<html>no</html>", b'"x"', b"[1]", b'{"error": "text"}', b'{"detail": "x"}'])
@pytest.mark.parametrize(("status", "expected"), [(500, RetryError), (400, QuestionError), (404, StopError)])
def test_complete_error_with_any_body_is_classified_by_status(
    server: Server, body: bytes, status: int, expected: type[Exception]
) -> None:
    server.respond = lambda handler: handler.send(status, body)
    with pytest.raises(expected, match=str(status)):
        _complete(_client(server))


@pytest.mark.parametrize(
    ("headers", "wait_s"),
    [
        ({"Retry-After": "7"}, 7.0),
        ({"Retry-After": "0"}, 0.0),
        ({"Retry-After": "1.5"}, 1.5),
        ({"Retry_After_Ms": "250", "Retry-After": "7"}, 0.25),
        ({"Retry-After": "300"}, 300.0),
        ({"Retry-After": "soon"}, None),
        ({"Retry-After": "-3"}, None),
        ({"Retry-After": "nan"}, None),
        ({"X_RateLimit_Remaining_Requests": "0", "X_RateLimit_Reset_Requests": "1m3.5s"}, 63.5),
        ({"X_RateLimit_Remaining_Tokens": "0", "X_RateLimit_Reset_Tokens": "120ms"}, 0.12),
        ({"X_RateLimit_Remaining_Tokens": "0", "X_RateLimit_Reset_Tokens": "7"}, 7.0),
        ({"X_RateLimit_Remaining_Tokens": "5", "X_RateLimit_Reset_Tokens": "7s"}, None),
        ({"X_RateLimit_Remaining_Tokens": "0", "X_RateLimit_Reset_Tokens": "1..s"}, None),
        ({}, None),
    ],
)
@pytest.mark.parametrize("status", [429, 503])
def test_complete_retry_after_seconds(server: Server, status: int, headers: dict[str, str], wait_s: float) -> None:
    server.respond = lambda handler: handler.send(status, _error("slow"), **headers)
    with pytest.raises(RetryError) as caught:
        _complete(_client(server))
    assert getattr(caught.value, "retry_after_s", None) == wait_s
    assert isinstance(caught.value, RateLimitError) == (status == 429 or wait_s is not None)


@pytest.mark.parametrize(("ahead_s", "wait_s"), [(90, 90.0), (-90, 0.0)])
def test_complete_retry_after_date_is_measured_by_the_servers_clock(
    server: Server, ahead_s: int, wait_s: float
) -> None:
    clock = 1_000_000_000  # 2001: far from ours

    def respond(handler: Handler) -> None:
        handler.date_time_string = lambda timestamp=None: formatdate(clock, usegmt=True)  # type: ignore[method-assign]
        handler.send(429, _error("slow"), **{"Retry-After": formatdate(clock + ahead_s, usegmt=True)})

    server.respond = respond
    with pytest.raises(RateLimitError) as caught:
        _complete(_client(server))
    assert caught.value.retry_after_s == wait_s


BROKEN = [
    b"",
    b"null",
    b"[]",
    b'"ok"',
    b"<html>welcome</html>",
    json.dumps(completion()).encode()[:-20],
    b"{}",
    b'{"choices": []}',
    b'{"choices": null}',
    b'{"choices": [{}]}',
    b'{"choices": [{"message": null}]}',
    b'{"choices": [{"message": {"content": 5}}]}',
    b'{"choices": [{"message": {"content": [5]}}]}',
    b'{"choices": [{"message": {"content": "x"}}], "usage": {"prompt_tokens": "many"}}',
    b'{"choices": [{"message": {"content": "x"}}], "usage": [3]}',
    b"\xff\xfe\x00",
]


@pytest.mark.parametrize("body", BROKEN)
@pytest.mark.parametrize("kind", ["application/json", "text/html"])
def test_complete_status_200_without_a_completion_is_tried_again(server: Server, body: bytes, kind: str) -> None:
    server.respond = lambda handler: handler.send(200, body, Content_Type=kind)
    with pytest.raises(RetryError, match="gpt:m: the reply is no"):
        _complete(_client(server))


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        ({"message": "x", "code": 429}, RateLimitError),
        ({"message": "x", "code": 400}, QuestionError),
        ({"message": "x", "code": "insufficient_quota"}, StopError),
        ({"message": "x"}, RetryError),
        ("x", RetryError),
    ],
)
def test_complete_error_inside_a_200_is_an_error(server: Server, error: Any, expected: type[Exception]) -> None:
    server.respond = lambda handler: handler.send(200, {"error": error})
    with pytest.raises(expected):
        _complete(_client(server))


@pytest.mark.parametrize("length", [10, 100_000])
def test_complete_cut_body_is_tried_again(server: Server, length: int) -> None:
    content = json.dumps(completion()).encode()
    server.respond = lambda handler: handler.send(200, content[:40], length=length)
    with pytest.raises(RetryError):
        _complete(_client(server))


def test_complete_bad_compression_is_tried_again(server: Server) -> None:
    server.respond = lambda handler: handler.send(200, b"not gzip", Content_Encoding="gzip")
    with pytest.raises(RetryError):
        _complete(_client(server))


def test_complete_dropped_connection_is_tried_again(server: Server) -> None:
    def hang_up(handler: Handler) -> None:
        handler.connection.shutdown(socket.SHUT_RDWR)
        handler.close_connection = True

    server.respond = hang_up
    with pytest.raises(LostReplyError, match="connection lost"):
        _complete(_client(server))
    assert len(server.bodies) == 1, "the request arrived, and may be billed"


def _refused(stack: ExitStack, server: Server) -> str:
    taken = stack.enter_context(socket.socket())
    taken.bind(("127.0.0.1", 0))
    return f"http://127.0.0.1:{taken.getsockname()[1]}"


def _full(stack: ExitStack, server: Server) -> str:
    """Linux drops what comes when a listener's queue is full: it has room for one more than it says."""
    listener = stack.enter_context(socket.socket())
    listener.bind(("127.0.0.1", 0))
    listener.listen(0)
    stack.enter_context(socket.create_connection(listener.getsockname()))
    return f"http://127.0.0.1:{listener.getsockname()[1]}"


@pytest.mark.parametrize(
    ("place", "says"),
    [
        (_refused, "Connect call failed"),
        (_full, "Connection timeout"),
        (lambda stack, server: "http://no-such-host.invalid", r"no-such-host\.invalid"),
        (lambda stack, server: f"https://127.0.0.1:{server.server_port}", "SSL|ssl"),
    ],
    ids=["refused", "full", "unknown name", "no TLS there"],
)
def test_complete_without_a_connection_sends_nothing_and_says_so(
    server: Server, place: Callable[[ExitStack, Server], str], says: str
) -> None:
    with ExitStack() as stack:
        client = _client(f"{place(stack, server)}/v1", connect_timeout_s=0.5)
        with pytest.raises(UnreachableError, match="no connection, nothing was sent") as caught:
            _complete(client)
    assert re.search(says, str(caught.value))
    assert not server.bodies


def test_complete_silent_server_times_out(server: Server) -> None:
    done = threading.Event()
    server.respond = lambda handler: done.wait(10) and None
    start = time.monotonic()
    with pytest.raises(RetryError, match=r"read timeout 0\.2 s"):
        _complete(_client(server, read_timeout_s=0.2))
    done.set()
    assert time.monotonic() - start < 5


def test_complete_server_that_drips_meets_the_deadline(server: Server) -> None:
    done = threading.Event()

    def drip(handler: Handler) -> None:
        handler.send_response(200)
        handler.send_header("Content-Length", "1000")
        handler.end_headers()
        while not done.wait(0.05):
            handler.wfile.write(b" ")

    server.respond = drip
    start = time.monotonic()
    with pytest.raises(RetryError, match=r"no reply within 0\.4 s"):
        _complete(_client(server, read_timeout_s=0.3, deadline_s=0.4))
    done.set()
    assert time.monotonic() - start < 5


@pytest.mark.parametrize("refused", [completion(None, refusal="I can't help"), completion("part of")])
def test_complete_refusal_drops_the_question(server: Server, refused: dict[str, Any]) -> None:
    if refused["choices"][0]["message"]["content"]:
        refused["choices"][0]["finish_reason"] = "content_filter"
    server.respond = lambda handler: handler.send(200, refused)
    with pytest.raises(QuestionError, match="refused"):
        _complete(_client(server))


def test_complete_keeps_to_its_concurrency(server: Server) -> None:
    def respond(handler: Handler) -> None:
        time.sleep(0.03)
        handler.send(200, completion())

    server.respond = respond
    assert len(_complete(_client(server, concurrency=2), *[TEXT] * 8)) == 8
    assert server.most_under_way == 2


def test_client_works_in_one_event_loop_after_another(server: Server) -> None:
    client = _client(server)
    assert [_complete(client)[0].text for _ in range(2)] == ["1", "1"]


def test_key_is_sent_and_shown_nowhere(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("F_TEST_KEY", KEY + "\n")
    client = _client(server, key_env="F_TEST_KEY")
    assert _complete(client)
    assert server.headers[0]["authorization"] == f"Bearer {KEY}"
    server.respond = lambda handler: handler.send(401, _error(f"Incorrect API key provided: {KEY}."))
    with pytest.raises(StopError) as caught:
        _complete(client)
    assert "***" in str(caught.value)
    pickled = pickle.dumps(client)
    for shown in (str(caught.value), repr(caught.value), repr(client), str(client.identity()), repr(pickled)):
        assert KEY not in shown
    assert repr(vars(client)).count(KEY) == 0
    again = pickle.loads(pickled)
    server.respond = lambda handler: handler.send(200, completion())
    assert _complete(again)[0].text == "1"


def test_key_missing_names_the_variable(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("F_TEST_KEY", raising=False)
    with pytest.raises(InputError, match="F_TEST_KEY"):
        _client(server, key_env="F_TEST_KEY")


def test_identity_holds_what_changes_a_reply_and_nothing_else(server: Server) -> None:
    base = _client(server).identity()
    assert base["model"] == "m"
    for same in ({"concurrency": 3}, {"read_timeout_s": 9.0}, {"deadline_s": 9.0}):
        assert _client(server, **same).identity() == base
    for other in ({"temperature": 0.5}, {"seed": 1}, {"repeat": 1}, {"images": {"side": 64}}, {"extra_body": {"a": 1}}):
        assert _client(server, **other).identity() != base


class TestStructured:
    CHOICE = Request("choice", (Message("user", ("Which?",)),), {"question": "Which?", "candidates": ["a", "b"]})

    def test_json_schema_is_sent_strict_and_the_prompt_asks_for_it(self, server: Server) -> None:
        _complete(_client(server, structured="json_schema"), self.CHOICE)
        body = server.bodies[0]
        assert body["response_format"]["type"] == "json_schema"
        form = body["response_format"]["json_schema"]
        assert (form["name"], form["strict"]) == ("choice", True)
        assert form["schema"]["properties"] == {"index": {"type": "integer", "enum": [0, 1]}}
        assert body["messages"][-1]["content"].startswith("Which?\n\n")
        assert "JSON" in body["messages"][-1]["content"]

    def test_json_object_names_no_schema(self, server: Server) -> None:
        _complete(_client(server, structured="json_object"), self.CHOICE)
        assert server.bodies[0]["response_format"] == {"type": "json_object"}
        assert "JSON" in server.bodies[0]["messages"][-1]["content"]

    @pytest.mark.parametrize("structured", ["none", "json_schema", "json_object"])
    def test_free_text_and_plain_endpoints_send_no_form(self, server: Server, structured: str) -> None:
        image = ImagePart(np.zeros((2, 2, 3), np.uint8))
        request = Request("view_answer", (Message("user", ("Q", image)),), {"question": "Q"})
        _complete(_client(server, structured=structured), request, *([self.CHOICE] if structured == "none" else []))
        assert all("response_format" not in body for body in server.bodies)
        assert all("JSON" not in json.dumps(body) for body in server.bodies)

    def test_it_counts_in_the_identity_and_plain_text_keeps_its_old_one(self, server: Server) -> None:
        identities = [_client(server, structured=way).identity() for way in ("none", "json_schema", "json_object")]
        assert len({json.dumps(identity, sort_keys=True) for identity in identities}) == 3
        assert "structured" not in identities[0]

    @pytest.mark.parametrize(
        "error",
        [
            {"message": "Invalid parameter: 'response_format' of type 'json_schema' is not supported.", "param": None},
            {"message": "no such thing", "param": "response_format"},
        ],
    )
    def test_a_server_that_refuses_it_stops_the_run_and_is_told_what_to_set(
        self, server: Server, error: dict[str, Any]
    ) -> None:
        server.respond = lambda handler: handler.send(400, {"error": {"type": "x", "code": None, **error}})
        with pytest.raises(StopError, match="takes no response_format json_schema: set structured of endpoint 'gpt'"):
            _complete(_client(server, structured="json_schema"), self.CHOICE)
        with pytest.raises(QuestionError):
            _complete(_client(server), self.CHOICE)

    def test_a_question_whose_words_are_repeated_cannot_stop_the_run(self, server: Server) -> None:
        server.respond = lambda handler: handler.send(400, _error("bad request: what is a response_format?"))
        request = Request("choice", (Message("user", ("What is a response_format?",)),), self.CHOICE.variables)
        with pytest.raises(QuestionError):
            _complete(_client(server, structured="json_schema"), request)

    def test_a_second_response_format_is_refused(self) -> None:
        with pytest.raises(ValueError, match="leave it out of extra_body"):
            _client("http://x/v1", structured="json_schema", extra_body={"response_format": {"type": "text"}})
