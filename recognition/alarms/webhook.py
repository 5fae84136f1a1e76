"""Events and heartbeats by HTTP POST.

The standard library does all that is needed: a request at a time, a time limit, proxies and certificates of the system.
Redirections are not followed, for they could carry the headers' secrets to somebody else.
"""

from __future__ import annotations

import urllib.error
import urllib.request
from http.client import HTTPException
from typing import Any
from urllib.parse import quote

from recognition.alarms.messages import Message
from recognition.alarms.options import WebhookOptions
from recognition.alarms.targets import RefusedError, UnreachableError
from rigcal import __version__

NEVER = (400, 413, 415, 422)
"""Answers that say that this message is at fault; a changed address or login mends all others."""


class _Direct(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, *args: Any, **kwargs: Any) -> None:
        """Follow nothing: what asks for it fails with its status."""
        del args, kwargs


class Webhook:
    """The target of a ``[[webhooks]]`` entry."""

    def __init__(self, options: WebhookOptions) -> None:
        self.name = options.name
        self._options = options
        self._opener = urllib.request.build_opener(_Direct)

    def send(self, message: Message) -> None:
        """POST an event; the header ``Idempotency-Key`` and ``message_id`` in it tell a repetition.

        Raises:
            UnreachableError: where nobody answers in time, or with another status than 2xx.
            RefusedError: where the answer is that the message is at fault.
        """
        self._post(message.body, {"Idempotency-Key": quote(message.message_id)})

    def beat(self, body: str) -> None:
        """POST a heartbeat; raises as :meth:`send`."""
        self._post(body, {})

    def close(self, *, in_order: bool) -> None:
        """Nothing is held open: who hears nothing more must take the site as NOT MONITORED by itself."""

    def _post(self, body: str, headers: dict[str, str]) -> None:
        request = urllib.request.Request(  # http and https only, says the alarms file's check
            self._options.url.get_secret_value(),
            body.encode(),
            {
                "Content-Type": "application/json",
                "User-Agent": f"recognition/{__version__}",
                **headers,
                **{name: value.get_secret_value() for name, value in self._options.headers.items()},
            },
            method="POST",
        )
        try:
            self._opener.open(request, timeout=self._options.timeout_s).close()
        except urllib.error.HTTPError as error:
            error.close()
            kind = RefusedError if error.code in NEVER else UnreachableError
            raise kind(f"{self._options.shown} answers {error.code}") from None
        except urllib.error.URLError as error:
            raise UnreachableError(f"{self._options.shown} cannot be reached: {_words(error.reason)}") from None
        except (OSError, HTTPException) as error:
            raise UnreachableError(f"{self._options.shown} does not answer: {_words(error)}") from None


def _words(reason: object) -> str:
    """What an error says, without anything that was sent."""
    if isinstance(reason, TimeoutError):
        return "timed out"
    if isinstance(reason, OSError) and reason.strerror:
        return reason.strerror
    return type(reason).__name__
