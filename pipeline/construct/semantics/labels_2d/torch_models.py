"""Loading of optional libraries and of torch models: late, and with errors a person can act on."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from schemas.errors import InputError

EXTRA = "pip install 'splatreasoner[open-set]'"


def require(module: str, extra: str = EXTRA) -> Any:
    """Return a module.

    Args:
        module: Its name.
        extra: How to install it.

    Raises:
        InputError: It is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise InputError(module, expected=f"an installed module ({extra})", found=str(error)) from error


def load_pretrained(kind: str, name: str) -> Any:
    """Return what `transformers.KIND.from_pretrained(name)` gives, from safetensors and plain files alone.

    A model that lacks weights is refused: the library would fill in random numbers, whose labels look like any others.

    Args:
        kind: Class of the transformers library.
        name: Local folder, or name on the hub.

    Raises:
        InputError: The library is missing, or there is no such model that it can load whole.
    """
    library = require("transformers")
    broken: type[Exception] = require("safetensors").SafetensorError
    expected = f"a model that {kind} loads"
    if Path(name).is_absolute() and not Path(name).is_dir():  # the library would speak of names on the hub
        raise InputError(name, expected=expected, found="no such folder")
    try:
        loader = getattr(library, kind)  # imports what this class needs, and fails where that does not fit
        if "Processor" in kind:
            return loader.from_pretrained(name, trust_remote_code=False)
        model, notes = loader.from_pretrained(
            name, trust_remote_code=False, use_safetensors=True, output_loading_info=True
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, ImportError, RuntimeError, broken) as error:
        first = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise InputError(name, expected=expected, found=first) from error
    learned = {key for key, _ in model.named_parameters()}
    if missing := sorted(learned.intersection(notes["missing_keys"])):
        raise InputError(name, expected=expected, found=f"no weights for {len(missing)} parameters ({missing[0]}, ...)")
    return model
