"""What runs log for TensorBoard, read back."""

from tensorboard.backend.event_processing import plugin_event_accumulator
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator, ScalarEvent
from tensorboard.util.tensor_util import make_ndarray


class Events(EventAccumulator):
    """Scalars are tensors of the plugin of that name, read as TensorBoard does: it shows the descriptions of no others.

    A run that begins again takes away what it had logged, which the older reader does for no tensor.
    """

    def __init__(self, folder):
        super().__init__(str(folder))
        self._tensors = plugin_event_accumulator.EventAccumulator(str(folder), tensor_size_guidance={"scalars": 0})

    def Reload(self):
        self._tensors.Reload()
        return super().Reload()

    def Tags(self):
        tags, scalars = super().Tags(), [*self._plugin_to_tag_to_content["scalars"]]
        return tags | {"scalars": scalars, "tensors": [tag for tag in tags["tensors"] if tag not in scalars]}

    def Scalars(self, tag):
        events = self._tensors.Tensors(tag)
        return [ScalarEvent(one.wall_time, one.step, make_ndarray(one.tensor_proto).item()) for one in events]
