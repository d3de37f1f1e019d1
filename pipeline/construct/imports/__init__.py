"""Features that other language fields learned, read for the Gaussians of a scene without running what a file brings."""

from pipeline.construct.imports.choose import ImportConfig
from pipeline.construct.imports.dr_splat import read_dr_splat
from pipeline.construct.imports.features import ImportedFeatures
from pipeline.construct.imports.langsplat import read_langsplat
from pipeline.construct.imports.opengaussian import read_opengaussian

__all__ = ["ImportConfig", "ImportedFeatures", "read_dr_splat", "read_langsplat", "read_opengaussian"]
