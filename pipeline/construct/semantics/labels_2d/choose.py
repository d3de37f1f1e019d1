"""Sources of meaning by name, imports among them: what a build's configuration may ask for."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, TypeAdapter, ValidationError

from pipeline.construct.semantics.imports import ImportConfig
from pipeline.construct.semantics.labels_2d.label_files import LabelFilesConfig
from pipeline.construct.semantics.labels_2d.sam_clip import SamClipConfig
from pipeline.construct.semantics.labels_2d.ssd_mobilenet import SsdMobilenetConfig
from pipeline.construct.semantics.labels_2d.torch_detector import TorchDetectorConfig
from pipeline.construct.semantics.labels_2d.ultralytics_detector import UltralyticsConfig
from schemas.errors import InputError

SourceConfig = Annotated[
    LabelFilesConfig | SsdMobilenetConfig | TorchDetectorConfig | UltralyticsConfig | SamClipConfig | ImportConfig,
    Field(discriminator="kind"),
]
"""Settings of one source; `kind` says which."""
MAIN = {
    "label_files": "folder",
    "ssd_mobilenet": "folder",
    "torch_detector": "model",
    "ultralytics": "weights",
    "sam_clip": "clip",
    "dr_splat": "file",
    "langsplat": "file",
    "opengaussian": "file",
}
"""The field that `KIND:VALUE` on the command line sets."""
_ADAPTER: TypeAdapter[SourceConfig] = TypeAdapter(SourceConfig)


def source_from_text(text: str) -> SourceConfig:
    """Return the settings that `KIND` or `KIND:VALUE` names, as `--semantics` takes them.

    Raises:
        InputError: There is no such source, or it needs a value.
    """
    kind, _, value = text.partition(":")
    if kind not in MAIN:
        raise InputError("semantics", field="source", expected="one of " + ", ".join(MAIN), found=text)
    try:
        return _ADAPTER.validate_python({"kind": kind, **({MAIN[kind]: value} if value else {})})
    except ValidationError as error:
        problem = error.errors()[0]
        field = ".".join(str(part) for part in problem["loc"])
        raise InputError(f"semantics {kind}", field=field, expected=f"{kind}:VALUE", found=problem["msg"]) from error
