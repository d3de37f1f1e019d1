"""The frame that baselines share: failures, unreadable replies, marks, stored captions, snapshot files."""

from __future__ import annotations

import asyncio
import dataclasses
import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.baselines.boxes import object_box, place_notes
from pipeline.baselines.config import (
    BlindConfig,
    FrameCaptionsConfig,
    MemorySnapshotsConfig,
    MultiFrameConfig,
    VoxelCaptionsConfig,
)
from pipeline.baselines.frames import even_frames
from pipeline.baselines.registry import answer_question, steps_of
from pipeline.baselines.voxel_map import voxel_objects
from pipeline.models.cache import CallCache
from pipeline.models.caller import Caller
from pipeline.models.messages import Request
from pipeline.models.prompts import Prompts
from pipeline.tasks.method import QuestionRows, SceneContext
from schemas.errors import InputError, QuestionError, RetryError
from schemas.questions import Question
from tests.query.tiny import STAGES, Scripted, box_points, caller_of, tiny_scene


def _question(number: int = 0, answer: str | None = "a cup") -> Question:
    return Question(f"q{number}", "tiny", "eqa", f"what is there, number {number}?", answer=answer)


def _rows(config: Any, client: Scripted | None = None, question: Question | None = None) -> QuestionRows:
    context = SceneContext(tiny_scene())
    asked = answer_question(context, question or _question(), caller_of(client or Scripted({})), config)
    return asyncio.run(asked)


def test_captions_are_paid_for_once_a_scene(tmp_path: Path) -> None:
    client = Scripted({})
    cache = CallCache(tmp_path)
    config, context = FrameCaptionsConfig(frames=4), SceneContext(tiny_scene())
    caller = Caller(dict.fromkeys(STAGES, client), Prompts.load(), cache)

    async def ask() -> list[QuestionRows]:
        return [await answer_question(context, _question(number), caller, config) for number in range(3)]

    rows = asyncio.run(ask())
    asyncio.run(caller.aclose())
    assert (client.count("caption"), client.count("answer_text")) == (4, 3)
    keys = [{call.key for call in row.calls if call.stage == "caption"} for row in rows]
    assert keys[0] == keys[1] == keys[2]
    assert all(call.cached for call in rows[1].calls if call.stage == "caption")


def test_a_caption_that_cannot_be_read_is_left_out_and_none_at_all_is_no_answer() -> None:
    told: list[Request] = []

    def answer(request: Request) -> str:
        told.append(request)
        return "A chair."

    first: list[Request] = []

    def caption(request: Request) -> str:
        first.append(request)
        return "" if len(first) <= 2 else "A table."

    rows = _rows(FrameCaptionsConfig(frames=3), Scripted({"caption": caption, "answer_text": answer}))
    assert len(told[0].variables["notes"]) == 2 + (len(first) > 5)
    assert rows.answers[0].status == "answered"
    none = _rows(FrameCaptionsConfig(frames=3), Scripted({"caption": " "}))
    assert (none.answers[0].status, none.arms[0].mark) == ("unparsed", None)
    assert "no description of pictures" in none.arms[0].mark_reason


@pytest.mark.parametrize("config", [BlindConfig(), MultiFrameConfig(), VoxelCaptionsConfig()])
def test_an_unreadable_answer_is_unparsed_and_unscored(config: Any) -> None:
    client = Scripted(dict.fromkeys(("answer_blind", "answer_one", "answer_text"), " "))
    rows = _rows(config, client)
    assert (rows.answers[0].status, rows.arms[0].mark) == ("unparsed", None)
    assert client.count("judge") == 0
    assert rows.arms[0].frames == (3 if config.kind == "multi_frame" else 0)


def test_marks_can_be_off_and_need_a_reference() -> None:
    assert _rows(BlindConfig(mark=False)).arms[0].mark_reason == "marks are off"
    assert _rows(BlindConfig(), question=_question(answer=None)).arms[0].mark_reason == "no reference answer"


def test_a_call_that_cannot_succeed_fails_the_question_with_its_calls() -> None:
    def refuse(request: Request) -> str:
        raise QuestionError("refused")

    rows = _rows(BlindConfig(), Scripted({"answer_blind": refuse}))
    assert (rows.answers[0].status, rows.answers[0].reason) == ("failed", "QuestionError: refused")
    assert [call.outcome for call in rows.calls] == ["QuestionError"]


def test_rows_of_an_error_carry_the_kind_and_its_one_arm() -> None:
    rows = steps_of(BlindConfig()).failed_rows(_question(), RetryError("down"), ())
    assert [(arm.arm, arm.method, arm.status) for arm in rows.arms] == [("final", "blind", "failed")]
    assert (rows.answers[0].method, rows.answers[0].reason) == ("blind", "RetryError: down")


@given(st.integers(1, 400), st.integers(1, 60))
def test_even_frames_hold_the_ends_and_are_evenly_spaced(count: int, wanted: int) -> None:
    frames = even_frames(count, wanted)
    assert len(frames) == min(count, wanted)
    assert frames[0] == 0
    if wanted > 1:
        assert frames[-1] == count - 1
    steps = [b - a for a, b in pairwise(frames)]
    assert not steps or (min(steps) >= 1 and max(steps) - min(steps) <= 1)


class TestSnapshotFiles:
    def _config(self, tmp_path: Path, content: Any) -> MemorySnapshotsConfig:
        (tmp_path / "tiny.json").write_text(content if isinstance(content, str) else json.dumps(content))
        return MemorySnapshotsConfig(file=str(tmp_path / "{scene}.json"))

    def test_those_of_the_evidence_are_shown_in_the_order_of_views(self, tmp_path: Path) -> None:
        content = {"view3.png": ["table", "chair"], "view1": ["chair"], "view0": ["zebra"]}
        config = self._config(tmp_path, content)
        rows = _rows(config, Scripted({"evidence": "chair"}))
        assert rows.arms[0].views == ("view1", "view3")
        assert rows.answers[0].clusters == 3
        assert steps_of(config).visibility(config) is None

    def test_no_snapshot_of_the_evidence_is_skipped_with_the_reason(self, tmp_path: Path) -> None:
        rows = _rows(self._config(tmp_path, {"view0": ["lamp"]}), Scripted({"evidence": "chair"}))
        assert (rows.answers[0].status, rows.answers[0].reason) == ("skipped", "no snapshot holds chair")

    @pytest.mark.parametrize(
        ("content", "message"),
        [
            ("[1", "expected JSON"),
            ([], "expected JSON: .* found list"),
            ({"view9": []}, "view9: expected a view of tiny, found none of that name"),
            ({"view0": "chair"}, "view0: expected a list of category names, found 'chair'"),
        ],
    )
    def test_a_wrong_file_is_refused(self, tmp_path: Path, content: Any, message: str) -> None:
        with pytest.raises(InputError, match=message):
            _rows(self._config(tmp_path, content))


def test_memory_is_built_from_what_views_see() -> None:
    rows = _rows(MemorySnapshotsConfig(max_distance_m=10.0), Scripted({"evidence": "chair"}))
    assert 1 <= rows.arms[0].frames <= 3
    far = _rows(MemorySnapshotsConfig(max_distance_m=0.1), Scripted({"evidence": "chair"}))
    assert far.answers[0].status == "skipped"


def test_voxel_objects_are_the_groups_that_touch() -> None:
    parts = [box_points((0, 0, 0), (0.2, 0.2, 0.2), 0.05), box_points((2, 0, 0), (0.4, 0.2, 0.2), 0.05)]
    means = np.concatenate([*parts, [[9.0, 9.0, 9.0]]])
    found = voxel_objects(means, 0.1, 2)
    small, large = len(parts[0]), len(parts[1])
    assert [ids.tolist() for ids in found] == [list(range(small, small + large)), list(range(small))]
    assert voxel_objects(means[:0], 0.1, 1) == []


def test_notes_say_what_stands_on_and_next_to_what() -> None:
    scene = tiny_scene()
    ids = [(scene.semantics.instance == number).nonzero()[0] for number in (0, 2, 1)]
    boxes = [object_box(scene, name, one) for name, one in zip(("chair", "table", "chair"), ids, strict=True)]
    notes = place_notes(boxes)
    assert notes[0] == "Place -1.5, 2.0, 0.4 m, size 0.4, 0.4, 0.8 m."
    cup = dataclasses.replace(boxes[0], name="cup", low=boxes[1].high - 0.1, high=boxes[1].high + 0.1)
    cup = dataclasses.replace(cup, low=cup.low * [1, 1, 0] + [0, 0, boxes[1].high[2]] - [0.2, 0.2, 0])
    assert place_notes([*boxes, cup])[3].startswith("It is on the table (object 1). Place")
