"""2D sources: what looks at photographs and says what their pixels show, one source a file behind one protocol."""

from pipeline.construct.semantics.labels_2d.source import FeatureSource, FrameFeatures, FrameLabels, LabelSource

__all__ = ["FeatureSource", "FrameFeatures", "FrameLabels", "LabelSource"]
