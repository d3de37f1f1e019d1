"""A question before it is chosen and numbered."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.scene.questions.names import capital


@dataclass(frozen=True, slots=True)
class Draft:
    """One possible question, with its answer."""

    kind: str
    """Form, such as "relation on"; the generator alternates between kinds."""
    question: str
    """The query."""
    answer: str | None
    """Reference answer; None for grounding."""
    targets: tuple[int, ...]
    """Positions of the objects asked about or asked for."""
    about: str
    """Category of the target, for grouping."""
    extra_answers: tuple[str, ...] = ()
    """Other accepted answers."""


def worded(rng: np.random.Generator, templates: tuple[str, ...], **parts: str) -> str:
    """Return one of the templates, filled, with a capital first letter."""
    template = templates[int(rng.integers(len(templates)))]
    return capital(template.format(**parts))
