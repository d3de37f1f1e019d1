"""Which model answers which stage, and how it is reached."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from pipeline.models.estimate import Price
from pipeline.models.messages import Stage
from pipeline.models.retry import RetryPolicy

STAGES: tuple[Stage, ...] = get_args(Stage)
"""Every stage that calls a model."""


class ImageConfig(BaseModel):
    """How pictures are sent to an endpoint."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    side: int = Field(
        512, ge=16, le=4096, description="longest side sent, pixels; a larger picture is shrunk, none is enlarged"
    )
    format: Literal["png", "jpeg"] = Field("png", description="png is exact; jpeg is smaller")
    jpeg_quality: int = Field(90, ge=1, le=100, description="JPEG quality; ignored for png")
    detail: Literal["low", "high", "auto"] | None = Field(
        "high", description="detail asked of the server (OpenAI's image detail); null sends none"
    )


class EndpointConfig(BaseModel):
    """One model behind one address, with its parameters."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["symbolic", "openai"] = Field(
        "symbolic", description="symbolic: the offline stand-in (no VLM); openai: a server with OpenAI's chat API"
    )
    base_url: str = Field("", description="address up to and with /v1, such as http://localhost:8000/v1")
    model: str = Field("", description="model name as the server knows it")
    key_env: str | None = Field(
        None, description="environment variable that holds the API key; null for a server that needs none"
    )
    temperature: float | None = Field(
        0.0, ge=0, le=2, description="sampling temperature; null sends none, as some reasoning models require"
    )
    top_p: float | None = Field(None, gt=0, le=1, description="nucleus sampling; null sends none")
    max_tokens: int | None = Field(1024, ge=1, description="longest reply, tokens; null sends no limit")
    max_tokens_field: Literal["max_tokens", "max_completion_tokens"] = Field(
        "max_tokens", description="what the server calls that limit; newer OpenAI models want max_completion_tokens"
    )
    seed: int | None = Field(None, description="sampling seed, where the server knows one; null sends none")
    repeat: int = Field(
        0,
        ge=0,
        description="number of an independent repetition: replies stored for another one are not used; seed + repeat "
        "is sent where there is a seed",
    )
    structured: Literal["none", "json_schema", "json_object"] = Field(
        "none",
        description="JSON replies, where the server offers them: none: plain text; json_schema: held to the stage's "
        "schema (OpenAI, vLLM, llama.cpp, Ollama); json_object: any JSON, the form told in words. Free text (view "
        "answers, captions) stays plain",
    )
    extra_body: dict[str, Any] = Field(
        default_factory=dict, description="further fields of the request, such as {reasoning_effort: low}"
    )
    images: ImageConfig = Field(default_factory=ImageConfig, description="how pictures are sent")
    connect_timeout_s: float = Field(10.0, gt=0, description="seconds to reach the server")
    read_timeout_s: float = Field(120.0, gt=0, description="longest silence of the server, seconds")
    deadline_s: float = Field(180.0, gt=0, description="longest time one request may take in all, seconds")
    concurrency: int = Field(
        8,
        ge=1,
        le=4096,
        description="most requests under way at once, over all processes of a run; halved while the server is "
        "overloaded",
    )
    requests_per_min: int | None = Field(
        None, ge=1, description="most requests in any 60 seconds, over all processes; null for no limit"
    )
    tokens_per_min: int | None = Field(
        None, ge=1, description="most tokens in any 60 seconds, prompts and replies; null for no limit"
    )
    image_tokens: int = Field(
        800, ge=0, description="tokens a picture takes, reckoned with until the server has counted some"
    )
    usd_per_million_prompt: float | None = Field(
        None, ge=0, description="price of a million prompt tokens, US dollars; null when nobody is to reckon with money"
    )
    usd_per_million_completion: float | None = Field(
        None, ge=0, description="price of a million reply tokens, US dollars"
    )

    @field_validator("key_env")
    @classmethod
    def _name_of_a_variable(cls, value: str | None) -> str | None:
        # A key pasted here would be written into run.json. Lower case is refused since keys have it.
        if value is not None and not re.fullmatch("[A-Z_][A-Z0-9_]*", value):
            raise ValueError("the name of an environment variable, in capitals, such as OPENAI_API_KEY")
        return value

    @field_validator("base_url")
    @classmethod
    def _address_without_secrets(cls, value: str) -> str:
        if value and not value.startswith(("http://", "https://")):
            raise ValueError("must begin with http:// or https://")
        if "@" in value or "?" in value:
            raise ValueError("must hold no user, password or query: name the key's environment variable in key_env")
        return value.rstrip("/")

    @model_validator(mode="after")
    def _address_and_model(self) -> EndpointConfig:
        if self.kind == "openai":
            for name in ("base_url", "model"):
                if not getattr(self, name):
                    raise ValueError(f"{name}: expected a text, which kind openai needs")
        if self.structured != "none" and "response_format" in self.extra_body:
            raise ValueError("structured sends response_format; leave it out of extra_body")
        if (self.usd_per_million_prompt is None) != (self.usd_per_million_completion is None):
            raise ValueError("give both prices, of prompts and of replies, or none")
        return self

    def identity(self) -> dict[str, Any]:
        """Return what changes a reply; timeouts, limits, prices and the key's variable do not."""
        kept = {"kind", "base_url", "model", "temperature", "top_p", "max_tokens", "seed", "extra_body", "images"}
        identity = self.model_dump(mode="json", include=kept)
        if self.repeat:
            identity["repeat"] = self.repeat
        if self.structured == "none":
            return identity
        from pipeline.models.reply_schemas import VERSION

        return identity | {"structured": self.structured, "schemas": VERSION}

    @property
    def price(self) -> Price | None:
        """What tokens cost; None where the endpoint gives no price."""
        if self.usd_per_million_prompt is None or self.usd_per_million_completion is None:
            return None
        return Price(self.usd_per_million_prompt, self.usd_per_million_completion)


class ModelConfig(BaseModel):
    """The models of a run. By default every stage is answered offline by the symbolic model."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    endpoints: dict[str, EndpointConfig] = Field(
        default_factory=lambda: {"symbolic": EndpointConfig()}, description="endpoints by a name of your choice"
    )
    default: str = Field("symbolic", description="endpoint of every stage not named in `stages`")
    stages: dict[Stage, str] = Field(
        default_factory=dict,
        description="endpoint by stage: evidence, view_answer, choice, verify, answer_one, answer_many, judge, "
        "caption, answer_text, answer_blind; choice needs a vision model where judging.design shows images",
    )
    prompts: Path | None = Field(
        None, description="folder of replacement prompts, files named as in pipeline/models/prompts; null for ours"
    )
    keep_prompts: bool = Field(
        True, description="keep the text of every request in table calls; false where prompts must not be stored"
    )
    max_asks: int = Field(2, ge=1, le=10, description="times a stage is asked before a reply counts as unreadable")
    retry: RetryPolicy = Field(default_factory=RetryPolicy, description="what is done about failures that may pass")

    @model_validator(mode="before")
    @classmethod
    def _symbolic_is_always_there(cls, data: Any) -> Any:
        if isinstance(data, dict) and isinstance(data.get("endpoints"), dict):
            return data | {"endpoints": {"symbolic": EndpointConfig()} | data["endpoints"]}
        return data

    @model_validator(mode="after")
    def _names_are_known(self) -> ModelConfig:
        for name in self.endpoints:
            if not name or ":" in name:
                raise ValueError(f"endpoint name {name!r} must not be empty or hold a colon")
        for place, name in [("default", self.default), *((f"stages.{s}", n) for s, n in self.stages.items())]:
            if name not in self.endpoints:
                raise ValueError(f"{place}: expected an endpoint: {', '.join(sorted(self.endpoints))}")
        return self

    def endpoint_of(self, stage: Stage) -> str:
        """Return the name of the endpoint that answers a stage."""
        return self.stages.get(stage, self.default)

    def remote_endpoints(self) -> tuple[str, ...]:
        """Return the names of the endpoints in use that are asked over a network, sorted."""
        used = {self.endpoint_of(stage) for stage in STAGES}
        return tuple(name for name in sorted(used) if self.endpoints[name].kind != "symbolic")

    def symbolic_stages(self) -> frozenset[Stage]:
        """Return the stages answered offline, whose replies cost nothing and are not stored."""
        return frozenset(stage for stage in STAGES if self.endpoints[self.endpoint_of(stage)].kind == "symbolic")
