"""Model configuration: defaults, errors that name the field, and which client answers which stage."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel, ValidationError

from pipeline.models.clients import make_caller, make_clients
from pipeline.models.config import STAGES, EndpointConfig, ImageConfig, ModelConfig
from pipeline.models.messages import ChatClient, Stage
from pipeline.models.retry import RetryPolicy
from schemas.errors import InputError

LOCAL = {"kind": "openai", "base_url": "http://localhost:8000/v1/", "model": "qwen3-vl:8b"}


def test_stages_are_those_of_the_protocol() -> None:
    assert set(STAGES) == set(get_args(Stage))


def test_default_is_the_symbolic_model_everywhere() -> None:
    config = ModelConfig()
    assert {config.endpoint_of(stage) for stage in STAGES} == {"symbolic"}
    assert config.symbolic_stages() == set(STAGES)
    clients = make_clients(config)
    assert set(clients) == set(STAGES)
    assert len({id(client) for client in clients.values()}) == 1
    assert all(isinstance(client, ChatClient) for client in clients.values())


def test_stages_may_use_different_endpoints() -> None:
    config = ModelConfig.model_validate(
        {"endpoints": {"local": LOCAL}, "stages": {"view_answer": "local", "answer_one": "local"}}
    )
    clients = make_clients(config)
    assert clients["view_answer"] is clients["answer_one"]
    assert clients["view_answer"].name == "local:qwen3-vl:8b"
    assert clients["choice"] is not clients["view_answer"]
    assert config.symbolic_stages() == set(STAGES) - {"view_answer", "answer_one"}
    assert config.endpoints["local"].base_url == "http://localhost:8000/v1"


def test_make_caller_stores_what_costs_and_nothing_else(tmp_path: Path) -> None:
    config = ModelConfig.model_validate({"endpoints": {"local": LOCAL}, "stages": {"judge": "local"}, "max_asks": 3})
    caller = make_caller(config, tmp_path / "calls")
    assert caller.uncached == set(STAGES) - {"judge"}
    assert caller.max_asks == 3
    assert caller.cache is not None
    assert make_caller(config, None).cache is None


def test_make_clients_missing_key_names_the_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_SUCH_KEY", raising=False)
    config = ModelConfig.model_validate({"endpoints": {"a": {**LOCAL, "key_env": "NO_SUCH_KEY"}}, "default": "a"})
    with pytest.raises(InputError, match="NO_SUCH_KEY"):
        make_clients(config)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"default": "gpt"}, "default: expected an endpoint: symbolic"),
        ({"stages": {"judge": "gpt"}}, "stages.judge: expected an endpoint"),
        ({"stages": {"judging": "symbolic"}}, "judging"),
        ({"endpoints": {"a:b": LOCAL}}, "colon"),
        ({"endpoints": {"a": {**LOCAL, "model": ""}}}, "model: expected a text"),
        ({"endpoints": {"a": {**LOCAL, "base_url": "localhost:8000"}}}, "http://"),
        ({"endpoints": {"a": {**LOCAL, "base_url": "http://me:secret@host/v1"}}}, "key_env"),
        ({"endpoints": {"a": {**LOCAL, "base_url": "http://host/v1?key=secret"}}}, "key_env"),
        ({"endpoints": {"a": {**LOCAL, "api_key": "sk-1"}}}, "api_key"),
        ({"endpoints": {"a": {**LOCAL, "temperature": 3}}}, "temperature"),
        ({"max_asks": 0}, "max_asks"),
        ({"retry": {"max_tries": 0}}, "max_tries"),
    ],
)
def test_config_bad_value_names_the_field(data: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        ModelConfig.model_validate(data)


@pytest.mark.parametrize("model", [ModelConfig, EndpointConfig, ImageConfig, RetryPolicy])
def test_every_field_is_documented(model: type[BaseModel]) -> None:
    assert [name for name, field in model.model_fields.items() if not field.description] == []


def test_config_survives_a_round_trip() -> None:
    config = ModelConfig.model_validate({"endpoints": {"local": LOCAL}, "default": "local"})
    assert ModelConfig.model_validate(config.model_dump(mode="json")) == config


def test_repetition_is_part_of_the_identity_only_from_the_second_on() -> None:
    first = EndpointConfig.model_validate({**LOCAL, "seed": 7})
    second = first.model_copy(update={"repeat": 1})
    assert "repeat" not in first.identity()  # replies stored before there were repetitions stay valid
    assert second.identity() == first.identity() | {"repeat": 1}


@pytest.mark.parametrize("keep", [True, False])
def test_make_caller_keeps_prompts_as_the_config_says(keep: bool) -> None:
    assert make_caller(ModelConfig(keep_prompts=keep), None).keep_prompts is keep
