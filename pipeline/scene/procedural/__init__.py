"""Built-in scenes: furnished apartments made from a seed, with ground truth and a walked camera path."""

from pipeline.scene.procedural.build import ProceduralScene, build_apartment
from pipeline.scene.procedural.layout import Room
from pipeline.scene.procedural.vocabulary import VOCABULARY

__all__ = ["VOCABULARY", "ProceduralScene", "Room", "build_apartment"]
