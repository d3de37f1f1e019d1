"""Benchmarks in their official files: questions as `Question` records, scenes that are missing, sets made by us."""

from pipeline.datasets.curate import ReferringSet, curate_referring, referring_faults
from pipeline.datasets.load import DATASET_KINDS, SUBSETS, DatasetKind, load_dataset_questions
from pipeline.datasets.missing import MissingScene, find_scene, missing_scenes

__all__ = [
    "DATASET_KINDS",
    "SUBSETS",
    "DatasetKind",
    "MissingScene",
    "ReferringSet",
    "curate_referring",
    "find_scene",
    "load_dataset_questions",
    "missing_scenes",
    "referring_faults",
]
