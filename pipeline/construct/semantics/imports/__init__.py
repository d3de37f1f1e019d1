"""Features that other language fields learned, read for the Gaussians of a scene without running what a file brings."""

from pipeline.construct.semantics.imports.choose import ImportConfig
from pipeline.construct.semantics.imports.dr_splat import read_dr_splat
from pipeline.construct.semantics.imports.features import ImportedFeatures
from pipeline.construct.semantics.imports.langsplat import read_langsplat
from pipeline.construct.semantics.imports.opengaussian import read_opengaussian

__all__ = ["ImportConfig", "ImportedFeatures", "read_dr_splat", "read_langsplat", "read_opengaussian"]
