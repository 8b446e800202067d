"""Addresses of the application's server, the names under which it may be requested, and the headers of its answers.

Python's standard library is all that this module needs: the page of the start is served before anything is imported.
"""

from __future__ import annotations

import hashlib
import ipaddress
import re
import secrets
from collections.abc import Iterable
from typing import Any

from deformnb.errors import DeformError

_ORIGIN = re.compile(r"https?://(?:[A-Za-z0-9.-]{1,253}|\[[0-9a-fA-F:.]{2,45}\])(?::[0-9]{1,5})?")


SECRET_HEADER = "X-Deformnb-Secret"
"""Header with the password, of requests for the state of the start."""


def checked_host(host: str) -> str:
    """The address to listen at: this machine only, or one address that is named in full.

    Raises
    ------
    DeformError
        If it means all addresses, or is no address: the names under which pages may be requested follow from it.

    Examples
    --------
    >>> checked_host("localhost")
    '127.0.0.1'
    """
    if host == "localhost":
        return "127.0.0.1"
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        raise DeformError(f"{host!r} is no address; name one of this machine, such as 127.0.0.1.") from None
    if address.is_unspecified or address.is_multicast:
        raise DeformError(f"{host} means every address of this machine; name the one that others are to use.")
    return str(address)


def is_loopback(host: str) -> bool:
    """Check whether only this machine reaches an address."""
    return ipaddress.ip_address(host).is_loopback


def own_names(host: str, port: int) -> frozenset[str]:
    """Allowed values of the header Host: a foreign site whose name was resolved to our address sends its own."""
    names = {f"[{host}]" if ":" in host else host}
    if is_loopback(host):
        names.add("localhost")
    return frozenset(f"{name}:{port}" for name in names)


def headers_for(name: str, framed_by: str = "'none'") -> dict[str, str]:
    """Headers of every answer: the page loads from and connects to this server only, and no other page may frame it."""
    # The client of trame compiles its templates in the page, which needs unsafe-eval.
    policy = {
        "default-src": "'self'",
        "script-src": "'self' 'unsafe-eval' blob:",
        "style-src": "'self' 'unsafe-inline'",
        "img-src": "'self' blob: data:",
        "font-src": "'self' data:",
        "connect-src": f"'self' ws://{name}",
        "object-src": "'none'",
        "base-uri": "'self'",
        "form-action": "'none'",
        "frame-ancestors": framed_by,
    }
    return {
        "Content-Security-Policy": "; ".join(f"{what} {where}" for what, where in policy.items()),
        "Cross-Origin-Resource-Policy": "same-origin",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Referrer-Policy": "no-referrer",
        "X-Content-Type-Options": "nosniff",
        "Cache-Control": "no-store",
    }


def checked_origin(origin: Any) -> str:
    """Check the origin of a page, as a browser sends it; DeformError for anything else: it becomes part of a header.

    Examples
    --------
    >>> checked_origin("http://localhost:8888")
    'http://localhost:8888'
    """
    if not isinstance(origin, str) or not _ORIGIN.fullmatch(origin):
        raise DeformError("a page's origin is http:// or https:// with a name and at most a port.")
    return origin


def digest_of(password: str) -> str:
    """Digest under which a password is stored, for the pages that stay open when the server ends.

    Examples
    --------
    >>> len(digest_of("secret"))
    64
    """
    return hashlib.sha256(password.encode()).hexdigest()


def is_password(given: Any, token: str, earlier: Iterable[str] = ()) -> bool:
    """Check a password against that of this start, and the digests of those of earlier ones.

    Examples
    --------
    >>> is_password("new", "new"), is_password("old", "new"), is_password("old", "new", [digest_of("old")])
    (True, False, True)
    """
    if not isinstance(given, str):
        return False
    digest = digest_of(given)
    return any(secrets.compare_digest(digest, known) for known in (digest_of(token), *earlier))
