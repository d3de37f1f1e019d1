"""Which scenes of a question file are not at hand, and where one gets them.

No data set here may be passed on by others: each wants an agreement signed, so scenes are named and never fetched.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from schemas.questions import Question
from schemas.storage import exists, join

_SCANNET_PAGE = "http://www.scan-net.org"
_SCANNET_TERMS = "sign the ScanNet Terms of Use and send them to the address on that page; the reply has the script"
_HM3D_PAGE = "https://aihabitat.org/datasets/hm3d"
_OPENEQA_PAGE = "https://github.com/facebookresearch/open-eqa/tree/main/data"


@dataclass(frozen=True, slots=True)
class SceneSource:
    """Where scenes of one kind come from; `{0}` stands for the scene's name and `{1}` for its scan's."""

    dataset: str
    """Name of the data set."""
    pattern: re.Pattern[str]
    """Scene names of this kind; the last group is the scan."""
    folders: tuple[str, ...]
    """Folders below a root where such a scene may lie; the first is the one to make."""
    page: str
    """Official page."""
    how: str
    """What one has to agree to, and to download."""


SOURCES = (
    SceneSource(
        "OpenEQA, ScanNet half",
        re.compile(r"\d{3}-scannet-(scene\d{4}_\d{2})"),
        ("{0}", "scannet-v0/{0}", "frames/scannet-v0/{0}", "scans/{1}", "scans_test/{1}"),
        _OPENEQA_PAGE,
        f"{_SCANNET_TERMS}. Fetch {{1}}.sens ({_SCANNET_PAGE}); its first 600 frames are the episode, extracted or not",
    ),
    SceneSource(
        "OpenEQA, HM3D half",
        re.compile(r"\d{3}-hm3d-([A-Za-z0-9]{11})"),
        ("{0}", "hm3d-v0/{0}", "frames/hm3d-v0/{0}"),
        _OPENEQA_PAGE,
        f"accept Matterport's terms for HM3D ({_HM3D_PAGE}), then run OpenEQA's extract-frames.py, with depth and "
        "poses: the ready-made archive is RGB only",
    ),
    SceneSource("ScanNet", re.compile(r"(scene\d{4}_\d{2})"), ("{0}", "scans/{0}"), _SCANNET_PAGE, _SCANNET_TERMS),
    SceneSource(
        "HM3D",
        re.compile(r"\d{5}-([A-Za-z0-9]{11})"),
        ("{0}", "val/{0}", "hm3d/val/{0}"),
        _HM3D_PAGE,
        "accept Matterport's terms for HM3D, then render frames with depth and poses in Habitat",
    ),
)
"""Told by the scene's name, the first that fits."""

OWN = SceneSource(
    "your own", re.compile("(.*)"), ("{0}",), "", "no data set has scenes of this name: put the folder there"
)


@dataclass(frozen=True, slots=True)
class MissingScene:
    """A scene that questions ask about and that is not there."""

    scene: str
    """Its name."""
    questions: int
    """How many questions ask about it."""
    dataset: str
    """Whose it is, by its name."""
    looked_in: tuple[str, ...]
    """Folders looked for; the first is the one to make."""
    page: str
    """The data set's official page; empty where none is known."""
    how: str
    """What to agree to and what to download."""

    def __str__(self) -> str:
        """Return one line that says all of it."""
        page = f" ({self.page})" if self.page else ""
        questions = "1 question" if self.questions == 1 else f"{self.questions} questions"
        return f"{self.scene}: {questions}; expected at {self.looked_in[0]}; {self.dataset}{page}: {self.how}"


def missing_scenes(questions: Iterable[Question], roots: Sequence[str]) -> tuple[MissingScene, ...]:
    """Return the scenes asked about that lie below none of the roots, by name.

    Args:
        questions: The questions of a run.
        roots: Folders, as paths or URIs, that hold scenes or captures; a data set's own folders below them are known.

    Raises:
        ValueError: There is no root.
        RetryError: A remote store failed to answer.
    """
    if not roots:
        raise ValueError("missing_scenes needs at least one root")
    missing = []
    for scene, count in sorted(Counter(question.scene for question in questions).items()):
        if find_scene(scene, roots) is None:
            source, scan = scene_source(scene)
            looked_in = tuple(scene_folders(scene, roots))
            how = source.how.format(scene, scan)
            missing.append(MissingScene(scene, count, source.dataset, looked_in, source.page, how))
    return tuple(missing)


def find_scene(scene: str, roots: Sequence[str]) -> str | None:
    """Return the first folder of a scene that is there, or None.

    Raises:
        RetryError: A remote store failed to answer.
    """
    return next((folder for folder in scene_folders(scene, roots) if exists(folder)), None)


def scene_folders(scene: str, roots: Sequence[str]) -> list[str]:
    """Return where a scene may lie, in the order to look."""
    source, scan = scene_source(scene)
    return [join(root, folder.format(scene, scan)) for folder in source.folders for root in roots]


def scene_source(scene: str) -> tuple[SceneSource, str]:
    """Return where scenes of such a name come from, and the scan's own name."""
    for source in SOURCES:
        match = source.pattern.fullmatch(scene)
        if match is not None:
            return source, match[1]
    return OWN, scene
