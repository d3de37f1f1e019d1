"""Caps on what a run may spend: calls, tokens, money."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict, Field


class BudgetConfig(BaseModel):
    """Hard caps of a run over all its endpoints and sessions. At a cap no call starts; the run ends, resumable."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    calls: int | None = Field(None, ge=0, description="most calls sent; null for no cap")
    tokens: int | None = Field(None, ge=0, description="most tokens, prompts and replies; null for no cap")
    usd: float | None = Field(
        None, ge=0, description="most money by the endpoints' prices, US dollars; null for no cap"
    )


@dataclass(slots=True)
class Spend:
    """What calls cost."""

    calls: int = 0
    """Calls."""
    tokens: int = 0
    """Tokens of prompts and replies."""
    usd: float = 0.0
    """US dollars by the endpoints' prices."""

    def add(self, calls: int, tokens: int, usd: float) -> None:
        """Add to all three; negative numbers take away."""
        self.calls += calls
        self.tokens += tokens
        self.usd += usd


class Budget:
    """Counts what is spent and what calls under way may still spend.

    Args:
        caps: The caps.
        spent: What earlier sessions of the run spent.
    """

    def __init__(self, caps: BudgetConfig, spent: Spend | None = None) -> None:
        self.caps, self.spent, self.reserved = caps, spent or Spend(), Spend()

    def reserve(self, tokens: int, usd: float) -> None:
        """Set a call's estimate aside."""
        self.reserved.add(1, tokens, usd)

    def settle(self, tokens: int, usd: float, used_tokens: int, used_usd: float) -> None:
        """Put what a call used in the place of what was set aside for it."""
        self.reserved.add(-1, -tokens, -usd)
        self.spent.add(1, used_tokens, used_usd)

    def release(self, tokens: int, usd: float) -> None:
        """Put back what was set aside for a call that was not sent."""
        self.reserved.add(-1, -tokens, -usd)

    def lacks(self, tokens: int, usd: float, *, reserved: bool) -> str:
        """Say which cap a call of this estimate would break; empty when none.

        Args:
            tokens: Most tokens it may use.
            usd: Most it may cost.
            reserved: Whether what is set aside counts. Without it, the answer is final: no call under way can free
                anything.
        """
        aside = self.reserved if reserved else Spend()
        for name, cap, used, wanted in (
            ("calls", self.caps.calls, self.spent.calls + aside.calls, 1),
            ("tokens", self.caps.tokens, self.spent.tokens + aside.tokens, tokens),
            ("usd", self.caps.usd, self.spent.usd + aside.usd, usd),
        ):
            if cap is not None and used + wanted > cap:
                return (
                    f"budget reached: {used:g} of {cap:g} {name} spent and the next call may take {wanted:g}; go on "
                    f"with a higher --max-{name}"
                )
        return ""
