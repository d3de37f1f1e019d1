"""The offline stand-in for language and vision models: rules over what a view shows."""

from pipeline.models.symbolic.model import RULES, SymbolicModel

__all__ = ["RULES", "SymbolicModel"]
