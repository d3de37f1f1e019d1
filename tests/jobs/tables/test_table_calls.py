"""Rows and tables that share stored replies: each pays for its difference alone."""

from __future__ import annotations

from http.server import ThreadingHTTPServer
from pathlib import Path

import pytest
import yaml

from jobs.tables.table_file import load_table
from jobs.tables.table_run import run_table
from jobs.tables.table_scores import table_cells
from schemas.question_file import load_questions, save_questions
from schemas.run_folder import read_table
from tests.jobs.test_endpoint_job import server as server


@pytest.mark.slow
def test_rows_send_only_the_calls_in_which_they_differ(
    apartment: str, server: ThreadingHTTPServer, tmp_path: Path
) -> None:
    asked = [q for q in load_questions(Path(apartment, "questions.jsonl")) if q.task == "eqa"][:2]
    save_questions(asked, tmp_path / "some.jsonl")
    address = f"http://127.0.0.1:{server.server_address[1]}/v1"
    endpoint = {"kind": "openai", "base_url": address, "model": "plain", "key_env": "MY_MODEL_KEY"}
    content = {
        "name": "costs",
        "base": {
            "output": "out",
            "scenes": apartment,
            "questions": "some.jsonl",
            "models": {"endpoints": {"plain": endpoint}, "default": "plain"},
            "workers": {"in_process": True},
        },
        "columns": {"match": {"label": "LLM-Match", "metric": "llm_match"}, "calls": {"label": "c", "metric": "calls"}},
        "rows": {
            "ours": {"label": "ours", "change": {}},
            "unverified": {"label": "no verification", "change": {"method.judging.verify": False}},
            "more": {"label": "V 8", "change": {"method.novel_views.count": 8}},
            "twice": {"label": "twice", "change": {}, "repeats": 2},
        },
    }

    def sent(name: str, row: str) -> int:
        path = tmp_path / f"{name}.yaml"
        path.write_text(yaml.safe_dump({**content, "name": name}, sort_keys=False))
        before = len(server.asked)  # type: ignore[attr-defined]
        assert run_table(load_table(path), (row,)).complete
        return len(server.asked) - before  # type: ignore[attr-defined]

    whole = sent("costs", "ours")
    assert whole > 0
    assert sent("costs", "unverified") == 0
    assert 0 < sent("costs", "more") < whole
    assert sent("another", "ours") == 0, "tables of one folder share runs"
    assert sent("costs", "twice") == whole, "the second repetition alone asks anew"
    table = load_table(tmp_path / "costs.yaml")
    cells = {(cell.row, cell.column): cell for cell in table_cells(table)}
    assert cells["twice", "match"].std == 0.0
    calls = read_table(table.place(*table.runs(("ours",))), "calls")
    method = calls[calls["stage"] != "judge"]
    assert cells["ours", "calls"].value == len(method) / len(asked)
