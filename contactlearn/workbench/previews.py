"""A slider that is being dragged: the page asks at /moved, and is answered without a round of callbacks.

    {"address": …, "of": parameter, "value": number}  →  {"v_post", "changes", "said"}, see `arrays.of_moved`

Nothing is kept: where the slider is let go an action follows.  `security` guards the path as it guards all others.
"""

import contextlib
import json
from typing import Any

from flask import Flask, Response, abort, jsonify, request

from contactlearn.core.errors import ContactLearnError
from contactlearn.core.numerics import is_number
from contactlearn.workbench import arrays
from contactlearn.workbench.actions import Actions
from contactlearn.workbench.models import Models
from contactlearn.workbench.panes import model
from contactlearn.workbench.session import Session


class Previews:
    """The answers to sliders that are being dragged."""

    def __init__(self, models: Models, actions: Actions) -> None:
        self.models, self.actions = models, actions

    def serve(self, server: Flask) -> None:
        """Serve them at /moved."""
        server.add_url_rule("/moved", "moved", self._answer, methods=["POST"])

    def _answer(self) -> Response:
        asked: Any = None
        with contextlib.suppress(ValueError):
            asked = json.loads(request.get_data(), parse_int=float)  # a whole number may be too large for one
        address, of, value = map(asked.get, ("address", "of", "value")) if isinstance(asked, dict) else (None,) * 3
        if not isinstance(address, str) or not isinstance(of, str) or not is_number(value):
            abort(400, "A slider says its address, its parameter and a number.")
        try:
            return jsonify(self.moved(address, of, value))
        except ContactLearnError as error:  # of a model that has gone
            abort(400, str(error))

    def moved(self, address: str, of: str, value: float) -> dict[str, Any]:
        """Return the outcomes and the error of the model of an address with one parameter moved.

        Raises:
            ContactLearnError: an address that cannot be read, or a number that is not finite.
        """
        session = self.actions.slide(Session.read(address), of, value)
        fitted, moved = self.models.fitted(session), self.models.moved(session)
        said = model.said(fitted, moved, self.models.alone(session), bool(session.hand))
        return arrays.of_moved(self.models.split(session).impacts, moved.v_post, moved.model) | {"said": said}
