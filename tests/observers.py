"""A consumer of events that records them."""


class RecordingObserver(list):
    """The events of a run in their order."""

    __call__ = list.append

    def of(self, kind):
        """Return the events of a type."""
        return [event for event in self if isinstance(event, kind)]

    def last(self, kind):
        """Return the last event of a type."""
        return self.of(kind)[-1]
