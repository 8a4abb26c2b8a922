"""What runs log for TensorBoard, read back."""

from tensorboard.backend.event_processing.event_accumulator import TENSORS, EventAccumulator, ScalarEvent
from tensorboard.util.tensor_util import make_ndarray


class Events(EventAccumulator):
    """Scalars are tensors of the plugin of that name: TensorBoard shows the descriptions of no others."""

    def __init__(self, folder):
        super().__init__(str(folder), size_guidance={TENSORS: 0})

    def Tags(self):
        tags, scalars = super().Tags(), [*self._plugin_to_tag_to_content["scalars"]]
        return tags | {"scalars": scalars, "tensors": [tag for tag in tags["tensors"] if tag not in scalars]}

    def Scalars(self, tag):
        return [ScalarEvent(e.wall_time, e.step, make_ndarray(e.tensor_proto).item()) for e in self.Tensors(tag)]
