"""Serve a GGUF model on this machine with OpenAI's chat API, for `examples/local.yaml`.

    python examples/local_model.py model.gguf --threads 2

Needs `pip install "splatreasoner[local]"`. Listens on the loopback address alone and ends with Ctrl-C. How to come by a
model, and what to expect of a small one: docs/local_model.md.
"""

from __future__ import annotations

import argparse
import contextlib
import threading
from pathlib import Path

import xllamacpp


def serve(model: Path, port: int, threads: int, context: int) -> xllamacpp.Server:
    """Return a running server; it stops when it is dropped.

    One request is answered at a time, so that all memory of the context is one prompt's, and the part that two prompts
    of a stage share is read once.
    """
    params = xllamacpp.CommonParams()
    params.model.path = str(model)
    params.model_alias = {model.stem}  # else replies, and with them tables, would name the path
    params.hostnames = ["127.0.0.1"]
    params.port = port
    params.n_ctx = context
    params.n_parallel = 1
    params.cpuparams.n_threads = threads
    params.cpuparams_batch.n_threads = threads
    params.ui = False
    params.verbosity = 1
    return xllamacpp.Server(params)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path, help="GGUF file")
    parser.add_argument("--port", type=int, default=8080)
    parser.add_argument("--threads", type=int, default=2, help="CPU threads")
    parser.add_argument("--context", type=int, default=4096, help="longest prompt and reply together, tokens")
    options = parser.parse_args()
    if not options.model.is_file():
        parser.error(f"{options.model}: no such file")
    server = serve(options.model, options.port, options.threads, options.context)
    print(f"{options.model.name} at {server.listening_address}/v1", flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        threading.Event().wait()


if __name__ == "__main__":
    main()
