"""How often and how long a call that failed for a passing reason is tried again."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from schemas.errors import RateLimitError, RetryError


class RetryPolicy(BaseModel):
    """How often and how long a call that failed for a passing reason is tried again."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    max_tries: int = Field(6, ge=1, description="times one request is sent before its error stands")
    first_wait_s: float = Field(1.0, ge=0, description="wait before the second try, seconds; doubles with each try")
    max_wait_s: float = Field(60.0, ge=0, description="longest wait of our own choosing, seconds")
    max_retry_after_s: float = Field(
        900.0, ge=0, description="longest wait a server may ask for, seconds; beyond it the error stands"
    )

    def wait_s(self, tries: int, error: RetryError, spread: float) -> float | None:
        """Return the seconds to wait after `tries` failures, or None when no further try is due.

        Args:
            tries: Failed sends so far, 1 or more.
            error: The latest failure; a RateLimitError's own wait is kept to the second.
            spread: 0 to 1; moves our own waits between three quarters and all of their length, so that callers that
                failed together do not come back together.
        """
        if tries >= self.max_tries:
            return None
        if isinstance(error, RateLimitError) and error.retry_after_s is not None:
            return error.retry_after_s if error.retry_after_s <= self.max_retry_after_s else None
        return min(self.first_wait_s * 2.0 ** (tries - 1), self.max_wait_s) * (0.75 + 0.25 * spread)


def spread_of(key: str, tries: int) -> float:
    """Return a number from 0 to 1 fixed by the call's key, so that no random state is needed and reruns wait alike."""
    return int(key[(tries * 8) % 56 : (tries * 8) % 56 + 8], 16) / 0xFFFFFFFF
