"""Imports by name: what a build's configuration may ask for."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from pipeline.construct.semantics.imports.dr_splat import read_dr_splat
from pipeline.construct.semantics.imports.features import ImportedFeatures
from pipeline.construct.semantics.imports.langsplat import read_langsplat
from pipeline.construct.semantics.imports.opengaussian import read_opengaussian


class ImportConfig(BaseModel):
    """Features that were learned elsewhere, for the same Gaussians."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["dr_splat", "langsplat", "opengaussian"]
    file: str = Field(
        description="chkpnt0.pth of Dr. Splat, chkpnt30000.pth of a LangSplat level, or cluster_lang.npz of "
        "OpenGaussian; {scene} stands for the scene's name."
    )
    beside: str = Field(
        default="", description="LangSplat: best_ckpt.pth of the autoencoder. Dr. Splat's codes: NPZ of the codebooks."
    )
    clip: str = Field(
        default="",
        description="Local folder or hub name of the CLIP model the features come from, to embed texts; empty brings "
        "none.",
    )

    def read(self, scene: str = "") -> ImportedFeatures:
        """Return the features.

        Raises:
            InputError: A file is missing or wrong.
        """
        file, beside = (path.replace("{scene}", scene) for path in (self.file, self.beside))
        if self.kind == "opengaussian":
            return read_opengaussian(file)
        return read_langsplat(file, beside) if self.kind == "langsplat" else read_dr_splat(file, beside)
