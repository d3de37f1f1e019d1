"""Downstream tasks: answering (EQA) and grounding one or many targets."""
