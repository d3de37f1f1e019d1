"""The part of a job file that names a benchmark by its official files."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from pipeline.datasets import DatasetKind

PATHS = ("path", "subset_file", "labels", "objects", "roots")
"""Fields that are relative to the job file."""


class DatasetConfig(BaseModel):
    """Questions of a benchmark, and where its scenes lie (docs/datasets.md)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: DatasetKind = Field(description="openeqa, scanrefer, multi3drefer, referring or jsonl")
    path: str = Field(min_length=1, description="its question file, a path or URI")
    subset: str = Field("all", min_length=1, description="a subset by name, such as 3dmem-1623")
    subset_file: str | None = Field(None, description="OpenEQA's list of ids; null looks beside the question file")
    labels: str | None = Field(None, description="ScanNet's label table; null looks beside the question file")
    objects: str | None = Field(None, description="ScanRefer's object names; null looks beside the question file")
    roots: tuple[str, ...] = Field(
        min_length=1, description="folders below which its scenes lie, each a scene folder named as its questions do"
    )
    missing: Literal["refuse", "skip"] = Field(
        "refuse", description="what to do with questions whose scene lies below no root; they are listed either way"
    )
