"""The one error tree. It is split by what the caller does next, not by where the error arose.

Every error below is a SplatReasonerError:

- InputError: fix the input and start again (exit code 2).
- RetryError: the same work may succeed later (network, a killed worker); RateLimitError says when, UnreachableError
  that nothing was sent, LostReplyError that the work may have been billed.
- QuestionError: this question cannot be answered; record the reason and go on.
- StopError: nothing further can succeed (bad key, budget reached, another driver): end the job.
- StoppedError: someone asked this work to stop; what it has is kept, and it goes on where it ended.
"""

from __future__ import annotations


class SplatReasonerError(Exception):
    """Base of every error this project raises on purpose."""


class InputError(SplatReasonerError):
    """Data or configuration that must be mended by a person before the work can be done.

    Args:
        subject: The file, URI or record at fault, with a line or row number where there is one.
        field: The field, property or column; empty where the whole subject is at fault.
        expected: What a valid value looks like.
        found: What was there instead.
    """

    def __init__(self, subject: object, *, field: str = "", expected: str, found: object) -> None:
        self.subject, self.field, self.expected, self.found = str(subject), field, expected, str(found)
        place = f"{self.subject}: {field}" if field else self.subject
        super().__init__(f"{place}: expected {expected}, found {self.found}")

    def __reduce__(self) -> tuple[object, ...]:
        """Keyword-only arguments do not survive the default pickling between processes."""
        return _rebuild_input_error, (self.subject, self.field, self.expected, self.found)


def _rebuild_input_error(subject: str, field: str, expected: str, found: str) -> InputError:
    return InputError(subject, field=field, expected=expected, found=found)


class RetryError(SplatReasonerError):
    """A failure that may pass: the same work is tried again, a bounded number of times."""


class RateLimitError(RetryError):
    """The endpoint asked us to slow down.

    Args:
        message: What the endpoint said.
        retry_after_s: Seconds it asked us to wait; None when it did not say.
    """

    def __init__(self, message: str, retry_after_s: float | None = None) -> None:
        super().__init__(message, retry_after_s)
        self.retry_after_s = retry_after_s

    def __str__(self) -> str:
        return str(self.args[0])


class UnreachableError(RetryError):
    """No connection to the endpoint came about: nothing was sent, so nothing was billed."""


class LostReplyError(RetryError):
    """A request went out and no whole reply came back: it may have been answered, and billed, all the same."""


class QuestionError(SplatReasonerError):
    """This question cannot be answered; its row carries the reason and the run goes on."""


class StopError(SplatReasonerError):
    """No further work can succeed: the run ends cleanly and can be resumed."""


class StoppedError(SplatReasonerError):
    """This work was asked to stop and kept what it had: the next session goes on from there."""
