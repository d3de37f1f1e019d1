from __future__ import annotations

import csv
import io
import json

import numpy as np
import pandas as pd
from hypothesis import given
from hypothesis import strategies as st

from jobs.frame_text import to_csv, to_json, to_latex, to_records

FRAME = pd.DataFrame(
    {
        "name": ["a_b & 50 %", "x\ny"],
        "mean": [1.25, np.nan],
        "count": pd.array([3, None], dtype=pd.Int32Dtype()),
        "views": [np.array(["a", "b"], dtype=object), ()],
    }
)


def test_records_are_plain_and_nothing_is_none() -> None:
    assert to_records(FRAME) == [
        {"name": "a_b & 50 %", "mean": 1.25, "count": 3, "views": ["a", "b"]},
        {"name": "x\ny", "mean": None, "count": None, "views": []},
    ]
    assert type(to_records(FRAME)[0]["count"]) is int


def test_json_holds_frames_as_rows_and_is_strict() -> None:
    found = json.loads(to_json({"run": "r", "rows": FRAME}), parse_constant=lambda name: 1 / 0)
    assert found["rows"][1]["mean"] is None


def test_latex_escapes_and_tells_words_from_numbers() -> None:
    text = to_latex(FRAME[["name", "mean", "count"]], ["name"], ["INCOMPLETE:\nhalf"])
    lines = text.splitlines()
    assert lines[0] == "% INCOMPLETE: half"
    assert lines[1] == r"\begin{tabular}{lrr}"
    assert r"a\_b \& 50 \% & 1.2 & 3 \\" in lines
    assert "-- & -- \\\\" in text


@given(
    st.lists(st.tuples(st.text(st.characters(exclude_categories=["Cs", "Cc"])), st.floats(allow_nan=False)), min_size=1)
)
def test_csv_reads_back_the_same(rows: list[tuple[str, float]]) -> None:
    frame = pd.DataFrame(rows, columns=["text", "number"])
    _, *found = csv.reader(io.StringIO(to_csv(frame), newline=""))
    assert [text for text, _ in found] == frame["text"].tolist()
    assert [float(number) for _, number in found] == frame["number"].tolist()
