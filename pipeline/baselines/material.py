"""What a baseline has gathered of the scene for one question, before any model answers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int32

from pipeline.models.messages import ImagePart
from pipeline.query.evidence import Evidence
from pipeline.query.stopwatch import StageTime
from schemas.answers import Status


@dataclass(frozen=True, slots=True)
class Material:
    """Pictures, notes or regions; picklable, like a proposal of the paper's method."""

    status: Status = "answered"
    """answered when there is something to answer from."""
    reason: str = ""
    """Why there is not."""
    categories: tuple[str, ...] = ()
    """Evidence categories."""
    pictures: tuple[ImagePart, ...] = ()
    """Images in the order in which they are shown or described."""
    names: tuple[str, ...] = ()
    """Of each picture: the view's name, and after a slash the object it was cut out around."""
    labels: tuple[str, ...] = ()
    """What each picture was cut out around; empty where pictures are whole."""
    notes: tuple[str, ...] = ()
    """What is known without a model, a line an object; of a picture that is described, what follows."""
    regions: tuple[Int32[np.ndarray, "_"], ...] = ()
    """Grounded Gaussians, one set a predicted instance."""
    activated: int = 0
    """Gaussians that take part."""
    objects: int = 0
    """Objects found."""
    stand_in: str = ""
    """Name of what stood in for features that the scene lacks; empty for none."""
    times: tuple[StageTime, ...] = ()
    """Seconds by stage."""

    @property
    def groups(self) -> tuple[()]:
        """Return no clusters with candidate views: only the paper's method has them."""
        return ()


def nothing(evidence: Evidence) -> Material:
    """Return the material of a question for which nothing is gathered."""
    return Material(evidence.status, evidence.reason, evidence.categories)
