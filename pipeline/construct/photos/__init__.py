"""Photographs moved onto their poses, and what they need for it."""
