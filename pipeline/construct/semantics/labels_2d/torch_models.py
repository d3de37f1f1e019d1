"""Loading of optional libraries and of torch models: late, and with errors a person can act on."""

from __future__ import annotations

from importlib import import_module
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

    Args:
        kind: Class of the transformers library.
        name: Local folder, or name on the hub.

    Raises:
        InputError: The library is missing, or there is no such model that it can load.
    """
    loader = getattr(require("transformers"), kind)
    weights = {} if "Processor" in kind or "Tokenizer" in kind else {"use_safetensors": True}
    try:
        return loader.from_pretrained(name, trust_remote_code=False, **weights)
    except (OSError, ValueError, KeyError, ImportError) as error:
        first = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise InputError(name, expected=f"a model that {kind} loads", found=first) from error
