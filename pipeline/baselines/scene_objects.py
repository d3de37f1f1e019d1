"""The objects of a scene as the paper's method finds them: clusters of every category and the views that see them."""

from __future__ import annotations

from pipeline.baselines.config import Objects
from pipeline.query.stopwatch import Stopwatch
from pipeline.query.visibility import VisibilityConfig
from pipeline.tasks.context import FoundCluster, SceneContext


def object_categories(context: SceneContext, config: Objects) -> list[str]:
    """Return the categories of a scene that are objects."""
    return [category for category in context.vocabulary if category not in config.background]


def scene_objects(
    context: SceneContext, config: Objects, watch: Stopwatch, *, every_view: bool = False
) -> list[FoundCluster]:
    """Return the objects, category by category, each with the recorded view that sees most of it.

    Args:
        context: The scene's caches.
        config: How objects are found.
        watch: Where seconds are kept.
        every_view: Whether more is asked of the visibility index than the best views.

    Raises:
        InputError: The scene lacks what activation needs.
    """
    method, categories = config.method(), object_categories(context, config)
    with watch.stage("cluster", len(categories)):
        for category in categories:
            context.clusters(category, method)
    index = context.index(config.visibility)
    if context.builds_index(categories, method) or (every_view and index.missing):
        with watch.stage("index", index.missing, whole_scene=True):
            index.build()
    with watch.stage("visibility", len(categories)):
        return [found for category in categories for found in context.found_clusters(category, method)]


def objects_index(config: object) -> VisibilityConfig | None:
    """Return the config of the visibility index that a baseline of objects reads."""
    objects: Objects | None = getattr(config, "objects", None)
    return None if objects is None else objects.visibility
