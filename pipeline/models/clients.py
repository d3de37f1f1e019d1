"""The clients and the caller that a model config describes; HTTP is imported only where an endpoint is asked."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pipeline.models.cache import CallCache
from pipeline.models.caller import Caller, Toll
from pipeline.models.config import STAGES, ModelConfig
from pipeline.models.estimate import Price, TokenEstimate
from pipeline.models.gate import Gate
from pipeline.models.messages import ChatClient, Stage
from pipeline.models.prompts import Prompts


def make_clients(config: ModelConfig, *, offline: bool = False) -> dict[Stage, ChatClient]:
    """Return a client for every stage; stages of one endpoint share it.

    Args:
        config: Models.
        offline: Whether clients stand in for the endpoints that know what they are and send nothing.

    Raises:
        InputError: An endpoint in use names an environment variable that is not set.
    """
    clients: dict[str, ChatClient] = {}
    for name in sorted({config.endpoint_of(stage) for stage in STAGES}):
        endpoint = config.endpoints[name]
        if endpoint.kind == "symbolic":
            from pipeline.models.symbolic import SymbolicModel

            clients[name] = SymbolicModel()
        elif offline:
            from pipeline.models.replay import OfflineClient

            clients[name] = OfflineClient(name, endpoint)
        else:
            from pipeline.models.endpoint import EndpointClient

            clients[name] = EndpointClient(name, endpoint)
    return {stage: clients[config.endpoint_of(stage)] for stage in STAGES}


def make_caller(
    config: ModelConfig, cache: Path | None, gates: Mapping[str, Gate] | None = None, *, replay: bool = False
) -> Caller:
    """Return the caller of a run.

    Args:
        config: Models, prompts and retries.
        cache: Folder of stored replies, such as a run's `calls`; None to store none.
        gates: By endpoint, where its calls wait their turn; those of endpoints without a gate never wait.
        replay: Whether stored replies are all there is: nothing is sent, and no key is needed.

    Raises:
        InputError: A key is not set or a prompt is wrong.
    """
    tolls = {}
    for name in config.remote_endpoints():
        endpoint = config.endpoints[name]
        price = endpoint.price or Price()
        estimate = TokenEstimate(endpoint.image_tokens, endpoint.max_tokens, price, endpoint.structured)
        tolls[name] = Toll((gates or {}).get(name), estimate, endpoint.price)
    return Caller(
        make_clients(config, offline=replay),
        Prompts.load(config.prompts),
        None if cache is None else CallCache(cache),
        max_asks=config.max_asks,
        retry=config.retry,
        uncached=config.symbolic_stages(),
        tolls=tolls,
        replay=replay,
        keep_prompts=config.keep_prompts,
    )
