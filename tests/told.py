"""An observer that remembers what it was told."""

from contactlearn.diagnosis.observer import Observer


class Told(Observer, dict):
    """The last result of each stage by the name of the observer's method, in the order in which they came first."""

    def audit(self, findings):
        self["audit"] = findings

    def laws(self, law, laws):
        self["laws"] = law, laws

    def left_out(self, candidates):
        self["left_out"] = candidates

    def law_changed(self, law):
        self["law_changed"] = law

    def missing(self, effects, regions):
        self["missing"] = effects
