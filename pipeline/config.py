"""The method's configuration: one small frozen config per stage, composed. Defaults are the paper's values."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from pipeline.query.activate import ActivationConfig
from pipeline.query.candidates import ImageConfig
from pipeline.query.cluster import ClusterConfig
from pipeline.query.evidence import EvidenceConfig
from pipeline.query.initial_views import InitialViewConfig
from pipeline.query.judge import JudgeConfig
from pipeline.query.perturb import NovelViewConfig
from pipeline.query.visibility import VisibilityConfig
from pipeline.tasks.region import GroundingConfig


class MethodConfig(BaseModel):
    """Every choice of the method. Two runs of equal config over equal scenes ask the same questions of the models."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["splatreasoner"] = Field(default="splatreasoner", description="The method: the paper's.")
    evidence: EvidenceConfig = Field(default_factory=EvidenceConfig, description="Evidence categories (paper 3.1).")
    activation: ActivationConfig = Field(default_factory=ActivationConfig, description="Gaussian search (paper 3.1).")
    clustering: ClusterConfig = Field(default_factory=ClusterConfig, description="Clusters (paper 3.1).")
    visibility: VisibilityConfig = Field(default_factory=VisibilityConfig, description="Visibility score (paper 3.1).")
    initial_views: InitialViewConfig = Field(
        default_factory=InitialViewConfig, description="How many clusters are kept (paper 3.1)."
    )
    novel_views: NovelViewConfig = Field(default_factory=NovelViewConfig, description="Novel views (paper 3.2).")
    images: ImageConfig = Field(default_factory=ImageConfig, description="What the models are shown (paper 3.4).")
    judging: JudgeConfig = Field(default_factory=JudgeConfig, description="Verification and marks (paper 3.3).")
    grounding: GroundingConfig = Field(default_factory=GroundingConfig, description="Regions (paper 3.4).")
