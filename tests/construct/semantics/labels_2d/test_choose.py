"""Sources by name, as the command line takes them."""

from __future__ import annotations

import pytest

from pipeline.construct.semantics.labels_2d.choose import MAIN, source_from_text
from schemas.errors import InputError


@pytest.mark.parametrize("kind", MAIN)
def test_every_kind_takes_its_main_value(kind: str) -> None:
    source = source_from_text(f"{kind}:some/where:else")
    assert source.kind == kind
    assert getattr(source, MAIN[kind]) == "some/where:else"


def test_kinds_with_defaults_need_no_value() -> None:
    assert source_from_text("ssd_mobilenet").kind == "ssd_mobilenet"
    assert source_from_text("sam_clip").kind == "sam_clip"


def test_an_unknown_kind_lists_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"expected one of label_files, ssd_mobilenet.* found yolo"):
        source_from_text("yolo")


def test_a_missing_value_is_asked_for() -> None:
    with pytest.raises(InputError, match=r"semantics label_files: .*folder: expected label_files:VALUE"):
        source_from_text("label_files")
