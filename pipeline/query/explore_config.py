"""Settings of the search for views that no camera took (policy `explore`)."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field


class ExploreWeights(BaseModel):
    """How much each term of a view's score counts, against 1 for the share of the cluster's patches that it shows."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    around: float = Field(default=0.5, ge=0, description="Share shown of the patches around the cluster.")
    size: float = Field(default=0.3, ge=0, description="Size in the image: 0 for 0.3 % of it, 1 from 6 % on.")
    centring: float = Field(default=0.2, ge=0, description="Against distance from the image's centre, 1 in a corner.")
    truncation: float = Field(default=0.3, ge=0, description="Against the share of the cluster outside the image.")
    unobserved: float = Field(default=1.0, ge=0, description="Against the share of pixels that no recorded view saw.")
    near: float = Field(default=0.5, ge=0, description="Against the share of pixels nearer than 0.5 m.")


class ExploreConfig(BaseModel):
    """Where the search may place a camera, what it renders, and what it looks for. Beyond the paper."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    renders: int = Field(default=20, ge=1, description="Coarse renders a cluster, at most: the cost of the search.")
    long_side: int = Field(default=112, ge=16, description="Longest side of a coarse render, pixels.")
    refine: float = Field(
        default=0.4, ge=0, lt=1, description="Share of the renders spent on steps from the best poses found."
    )
    cell_m: float = Field(default=0.1, gt=0, description="Side of a cell of the map of free space, metres.")
    clearance_m: float = Field(default=0.25, gt=0, description="Least distance of a pose from surfaces, metres.")
    reach_m: float = Field(default=1.5, gt=0, description="Farthest a pose may be from a recorded camera, metres.")
    height_margin_m: float = Field(
        default=0.5, ge=0, description="How far poses may leave the heights of the recorded cameras, metres."
    )
    farthest_m: float = Field(default=5.0, gt=0, description="Farthest a pose may be from the cluster, metres.")
    surroundings_m: float = Field(
        default=0.5, ge=0, description="What is this near to the cluster should be seen, too, metres."
    )
    weights: ExploreWeights = Field(default_factory=ExploreWeights, description="Terms of a view's score.")
