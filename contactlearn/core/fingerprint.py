"""SHA-256 of names and numbers that come in blocks, however they are cut: the same for one block and for many."""

import hashlib
from collections import defaultdict
from collections.abc import Iterable
from typing import Any

from torch import Tensor


class Fingerprint:
    """Digest of fields by name, each of which may be continued."""

    def __init__(self) -> None:
        self._digests = defaultdict[str, Any](hashlib.sha256)

    def add_numbers(self, field: str, values: Tensor) -> None:
        """Continue a field with numbers."""
        self._digests[field].update(values.cpu().contiguous().numpy().data)

    def add_texts(self, field: str, texts: Iterable[str]) -> None:
        """Continue a field with texts."""
        self._digests[field].update("".join(map(repr, texts)).encode())

    def set_text(self, field: str, text: str) -> None:
        """Replace a field by a text that is the same for every block."""
        self._digests[field] = hashlib.sha256(text.encode())

    def hexdigest(self) -> str:
        """Digest of all fields so far."""
        parts = sorted((field, digest.hexdigest()) for field, digest in self._digests.items())
        return hashlib.sha256(repr(parts).encode()).hexdigest()
