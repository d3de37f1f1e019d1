"""Question generators over ground-truth objects."""

from pipeline.scene.questions.generate import EQA_MAKERS, GROUNDING_MAKERS, generate_questions
from pipeline.scene.questions.world import Room

__all__ = ["EQA_MAKERS", "GROUNDING_MAKERS", "Room", "generate_questions"]
