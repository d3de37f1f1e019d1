"""A whole job with models behind a local server: paid once, resumed for nothing, and the key is nowhere on disk."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from jobs.config import JobConfig
from jobs.runs.results import RESULTS
from jobs.runs.submit import resume, submit
from schemas.manifest import committed_units, manifest_uri
from schemas.question_file import load_questions, save_questions
from schemas.run_folder import read_table

KEY = "sk-never-to-be-written-0000"


class PlainModel(BaseHTTPRequestHandler):
    """Gives the simplest reply that fits each of our prompts; knows them by what they ask for."""

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self.server.asked.append((self.headers["Authorization"], body))  # type: ignore[attr-defined]
        parts = [
            p for m in body["messages"] for p in ([m["content"]] if isinstance(m["content"], str) else m["content"])
        ]
        text = "\n".join(part if isinstance(part, str) else part.get("text", "") for part in parts)
        images = sum(isinstance(part, dict) and part["type"] == "image_url" for part in parts)
        reply = {
            "model": body["model"],
            "choices": [
                {"index": 0, "finish_reason": "stop", "message": {"role": "assistant", "content": say(text, images)}}
            ],
            "usage": {"prompt_tokens": 7 + images, "completion_tokens": 3, "total_tokens": 10 + images},
        }
        data = json.dumps(reply).encode()
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *_: Any) -> None:
        """Quiet."""


def say(text: str, images: int) -> str:
    if "Which categories" in text:
        offered = text.split("one a line:")[1].split("Which categories")[0].split("\n")
        return "\n".join([name for name in offered if name.strip()][:3])
    if "Your mark" in text:
        return "Your mark: 3"
    if "Image 0: Yes" in text or "Image 1: Yes" in text:
        return "\n".join(f"Image {i}: {'Yes' if i == 0 else 'No'}" for i in range(images))
    if "the word Image" in text:
        return "Image 0\nA chair beside the wall."
    if re.search(r"index", text):
        return "0"
    return "A chair beside the wall."


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[ThreadingHTTPServer]:
    found = ThreadingHTTPServer(("127.0.0.1", 0), PlainModel)
    found.asked = []  # type: ignore[attr-defined]
    thread = threading.Thread(target=found.serve_forever, daemon=True)
    thread.start()
    monkeypatch.setenv("MY_MODEL_KEY", KEY)
    yield found
    found.shutdown()
    found.server_close()
    thread.join()


def test_a_job_with_an_endpoint_pays_once_and_keeps_the_key_off_disk(
    apartment: str, server: ThreadingHTTPServer, tmp_path: Path
) -> None:
    questions = tmp_path / "some.jsonl"
    save_questions(load_questions(Path(apartment, "questions.jsonl"))[::3], questions)
    endpoint = {
        "kind": "openai",
        "base_url": f"http://127.0.0.1:{server.server_address[1]}/v1",
        "model": "plain",
        "key_env": "MY_MODEL_KEY",
    }
    job = JobConfig.model_validate(
        {
            "name": "endpoint",
            "output": str(tmp_path / "run"),
            "scenes": apartment,
            "questions": str(questions),
            "models": {"endpoints": {"plain": endpoint}, "default": "plain"},
            "workers": {"in_process": True},
        }
    )
    run = submit(job).run
    asked = server.asked  # type: ignore[attr-defined]
    calls = read_table(run, "calls")
    answers = read_table(run, "answers")
    assert set(answers["status"]) == {"answered"}, answers["reason"].tolist()
    assert {header for header, _ in asked} == {f"Bearer {KEY}"}
    assert len(asked) == (~calls["cached"]).sum() > len(answers)
    assert calls["prompt_tokens"].min() >= 7
    results = {p.name: p.read_bytes() for p in Path(run, RESULTS).iterdir()}

    for unit in committed_units(run):
        Path(manifest_uri(run, unit)).unlink()
    sent = len(asked)
    assert resume(run).driven.complete
    assert len(asked) == sent, "a call that was answered is never sent again"
    assert {p.name: p.read_bytes() for p in Path(run, RESULTS).iterdir()} == results
    for path in Path(run).rglob("*"):
        assert not path.is_file() or KEY.encode() not in path.read_bytes(), path
