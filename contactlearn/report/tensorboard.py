"""Record of one run: TensorBoard events and, beside them, metrics.jsonl with one record a line.

It grows with the run: every value is on disk as soon as it is logged, so that a killed run keeps its record.

The x axis of a scalar is the number of training impacts, so that the runs of a sweep over sizes
lie along a learning curve; of `fit/…` it is the round of a training.  Of a value with a 95 % interval the mean has the
tag itself, `TAG`, and the ends have `interval/TAG/low` and `interval/TAG/high`, which margin charts are drawn from.
These are the tags of metrics.jsonl.  TensorBoard, whose first page has tags for headings, gets those of `shown_as`.

Hyperparameters go into the run's one event file, and booleans as booleans: TensorBoard's `add_hparams` would make
a stray run of its own, and numbers of them.
"""

import itertools
import json
import math
import os
import re
import socket
import statistics
import struct
import time
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

from jaxtyping import Float
from tensorboard.compat.proto import event_pb2
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.compat.proto.tensor_pb2 import TensorProto
from tensorboard.compat.proto.types_pb2 import DT_FLOAT, DT_STRING
from tensorboard.plugins.custom_scalar import metadata as custom_scalar
from tensorboard.plugins.custom_scalar.layout_pb2 import Chart, Layout, MultilineChartContent
from tensorboard.plugins.hparams import api_pb2, metadata
from tensorboard.plugins.hparams.plugin_data_pb2 import HParamsPluginData, SessionEndInfo, SessionStartInfo
from tensorboard.plugins.scalar import metadata as scalar
from tensorboard.plugins.text import metadata as text
from tensorboard.summary.writer.record_writer import RecordWriter
from torch import Tensor
from torch.utils.tensorboard import summary

from contactlearn.core.numerics import Z_95, bin_edges
from contactlearn.diagnosis.events import EffectsFound, Event, LimitsEstimated
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.learning.events import CurvePoint, RoundScored, TrainingRound
from contactlearn.report.text.names import capitalize_first, label, model_label

_SHOWN = ("command", "effects", "law", "model", "train_size")
_KINDS: Mapping[type, tuple[str, int]] = {
    bool: ("bool_value", api_pb2.DATA_TYPE_BOOL),
    str: ("string_value", api_pb2.DATA_TYPE_STRING),
}
_NUMBER = ("number_value", api_pb2.DATA_TYPE_FLOAT64)
_BINS = 30  # of a histogram
_FILES = itertools.count()
_SCALARS = scalar.create_summary_metadata("", "")
ERRORS, CURVES, STEPS = "Errors", "Learning curves", "Steps of the ladder"
TRAINING, TRANSFER = "Rounds of training", "Transfer to other bodies"
"""Groups of what TensorBoard shows, which it sorts by name."""
_ONE_NUMBER = "One number of this run, by which the table under HParams compares runs."
_HEADINGS = {
    r"curve_\w+?_error/(.*)": (
        f"{CURVES}/{{}}",
        "Mean held-out error of a model, or of a bound, against the number of training impacts.",
    ),
    r"transfer_\w+?_error/(.*)": (
        f"{TRANSFER}/{{}}",
        "Held-out error on another body against the number of its training impacts.",
    ),
    r"ladder/(\w+)_error": (
        f"{STEPS}/{{}} error",
        "Held-out error at steps 0, 1, 2 …: law, first effect, …, Gaussian processes; named under Text. Here smoothing "
        "bends it; Custom Scalars draws it as it is, and Errors/Ladder with names.",
    ),
    r"floor/\w+_error": (f"{STEPS}/Noise alone", "Error of noise alone: no model of the state comes below it."),
    r"fit/(.*)": (f"{TRAINING}/{{}}", "By round of one training: loss, and error and log density on held-out trials."),
    r"figures/error_comparison.*": (f"{ERRORS}/All models", "Held-out error of each model by trial."),
    r"figures/ladder": (
        f"{ERRORS}/Ladder",
        "Held-out error of the law, with one effect after another, and of noise, with 95 % intervals.",
    ),
    r"figures/audit_(.*)": ("Figures/Audit of the data: {}", "Whether the impacts obey the balance of moments."),
    r"figures/effect_(.*)": ("Figures/Effect: {}", "What the effect explains of the residual: a dot is a trial."),
    r"figures/(.*)": ("Figures/{}", "As in the run's folder, where the PDF is too."),
    r"residuals/(.*)": ("Residuals/{}", "Measured minus predicted, on held-out trials, in m/s and rad/s."),
    r"(\w+)_error/model": ("HParams/{} error of the model", f"{_ONE_NUMBER} Held-out: lower is better."),
    r"(\w+)_error/irb": (
        "HParams/{} error of the ideal rigid-body bound",
        f"{_ONE_NUMBER} No impulse at the measured contact point has a lower held-out error.",
    ),
}
"""What TensorBoard shows a tag as, and its description; `{}` is the group of the pattern in words."""
_WORDS = {
    "budget": "Shares of the law's error",
    "frontier": "Error by number of effects",
    "regions": "Where the law fails",
    "residual": "What is left",
    "scatter": "Scatter of the contact by impact",
    "scatter_impulses": "Scatter of the contact in impulse space",
    "training": "Training, and relevance of the features",
    "patch_curve": "IRB bound by width of the contact patch",
    "energy_ellipse": "One impact in impulse space",
    "trial_parameters": "Friction and restitution of each trial",
    "convergence": "Coefficients by number of trials",
    "cost_surface": "Error over friction and restitution",
    "calibration": "Calibration of the predicted 95 % ellipsoids",
    "calibration_of_trained": "Calibration of the trained models",
}

Charts = Mapping[str, Mapping[str, str | Sequence[str]]]
"""Tags of the charts of the custom scalars by category and title.

Tags in a list are lines in one chart, which no smoothing bends, with their intervals where those are shown; tags that
a run lacks are left out.  A string is a regular expression of what TensorBoard shows as lines that it smooths.

TensorBoard joins the charts of all runs under the categories of the first, and loses charts that differ between runs
under any other: a category has the same charts in every run that has it.
"""
METRICS_FILE = "metrics.jsonl"
SUMMARY = "Summary of the run"
NO_CHARTS: Charts = MappingProxyType({})


def ends(tag: str) -> tuple[str, str]:
    """Return the tags of the low and high end of the interval of a value."""
    return f"interval/{tag}/low", f"interval/{tag}/high"


def shown_as(tag: str) -> str:
    """Return what TensorBoard shows a tag as: Steps of the ladder/Mass error for ladder/mass_error."""
    return _heading(tag)[0]


def _heading(tag: str) -> tuple[str, str]:
    """What TensorBoard shows a tag as, and its description; a tag that is not known stays as it is."""
    if end := re.fullmatch(r"interval/(.*)/(low|high)", tag):
        of, _ = _heading(end[1])
        return f"{of}, {end[2]} end", f"The 95 % interval of {of} has this {end[2]} end."
    for pattern, (heading, description) in _HEADINGS.items():
        if found := re.fullmatch(pattern, tag):
            words = re.sub(r"[^/, ][^/,]*", _in_words, found[1]) if found.groups() else ""
            group, _, name = heading.format(words).partition("/")
            return f"{group}/{capitalize_first(name)}", description
    return tag, ""


def _in_words(part: re.Match[str]) -> str:
    """A part of a tag as a person writes it; settings, such as law=mirtich, and symbols, such as v_x, are as typed."""
    name = part[0]
    return name if "=" in name or name[1:2] == "_" else _WORDS.get(name) or label(model_label(name))


class _EventFile:
    """An event file of TensorBoard.  Its `SummaryWriter` would leave the error of a full disk to a thread."""

    def __init__(self, folder: Path) -> None:
        name = f"events.out.tfevents.{int(time.time()):010d}.{socket.gethostname()}.{os.getpid()}.{next(_FILES)}"
        folder.mkdir(parents=True, exist_ok=True)
        self._records = RecordWriter((folder / name).open("wb"))
        self.write(event_pb2.Event(file_version="brain.Event:2"))

    def begin(self) -> None:
        """Let TensorBoard hide what was logged before, also in older files of the folder."""
        self.write(event_pb2.Event(session_log=event_pb2.SessionLog(status=event_pb2.SessionLog.START)))

    def write(self, event: event_pb2.Event) -> None:
        """Write an event to the disk."""
        event.wall_time = time.time()
        self._records.write(event.SerializeToString())
        self._records.flush()

    def close(self) -> None:
        """Close the file."""
        self._records.close()


class Tracker:
    """Writes scalars, charts, figures, hyperparameters and a card of one run into `folder`; a context manager.

    Nothing is written before the first value.  Then TensorBoard hides what a former attempt in the folder logged,
    unless it is `continued`; its events stay, since TensorBoard reads no further where a file vanishes.

    Args:
        folder: of the run.
        trained_on: number of training impacts of its model.
        charts: of the custom scalars.
        continued: what follows is logged beside what a former attempt logged.
        shown: pattern of the tags that TensorBoard has; metrics.jsonl has all.
    """

    def __init__(
        self,
        folder: Path,
        trained_on: int,
        charts: Charts = NO_CHARTS,
        *,
        continued: bool = False,
        shown: str = ".*",
    ) -> None:
        self._folder, self._trained_on, self._charts, self._continued = folder, trained_on, charts, continued
        self._shown = re.compile(shown)
        self._settings: list[Summary] = []

    @cached_property
    def _file(self) -> _EventFile:
        file = _EventFile(self._folder)
        if not self._continued:
            file.begin()
            (self._folder / METRICS_FILE).unlink(missing_ok=True)
        layout = Layout()
        for category, charts in self._charts.items():
            drawn = [self._chart(title, tags) for title, tags in charts.items()]
            layout.category.add(title=category, chart=drawn)
        content = TensorProto(dtype=DT_STRING, string_val=[layout.SerializeToString()])
        value = Summary.Value(tag=custom_scalar.CONFIG_SUMMARY_TAG, tensor=content)
        value.metadata.plugin_data.plugin_name = custom_scalar.PLUGIN_NAME
        file.write(event_pb2.Event(summary=Summary(value=[value])))
        return file

    def _chart(self, title: str, tags: str | Sequence[str]) -> Chart:
        if isinstance(tags, str):
            return Chart(title=title, multiline=MultilineChartContent(tag=[tags]))
        chart = Chart(title=title)
        for tag in tags:  # a margin of no width where no interval is shown: lines of the other kind are smoothed
            low, high = (end if self._shown.fullmatch(end) else tag for end in ends(tag))
            chart.margin.series.add(value=shown_as(tag), lower=shown_as(low), upper=shown_as(high))
        return chart

    def __enter__(self) -> "Tracker":
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        for content in self._settings if error is None else ():
            self._add(content, 0)
        self.close()

    def close(self) -> None:
        """Close the file of events, if there is one."""
        if "_file" in vars(self):
            self._file.close()

    def begin_again(self) -> None:
        """Log in place of all that was logged so far."""
        self._file.begin()
        (self._folder / METRICS_FILE).unlink(missing_ok=True)

    def __call__(self, event: Event) -> None:
        """Log the numbers of a training, a learning curve or a diagnosis as it goes on; other events have none."""
        values: dict[str, float | Interval]
        if isinstance(event, TrainingRound):
            values = {"fit/loss": statistics.fmean(event.loss.values())}
            for output, loss in event.loss.items():
                values |= {f"fit/loss/{output}": loss, f"fit/noise/{output}": event.noise[output]}
                lengths = event.length_scales[output]
                values |= {f"fit/length_scale/{output}/{feature}": x for feature, x in lengths.items()}
            self._log(values, event.round, {"trained_on": event.trained_on, "round": event.round})
        elif isinstance(event, RoundScored):
            values = {f"fit/{metric}": error for metric, error in event.errors.items()}
            values["fit/negative_log_density"] = event.negative_log_density
            self._log(values, event.round, {"trained_on": event.trained_on, "round": event.round})
        elif isinstance(event, CurvePoint):
            values = {f"curve_{metric}/{event.model}": error for metric, error in event.errors.items()}
            values |= {f"curve_loss/{event.model}/{output}": loss for output, loss in event.loss.items()}
            values |= {f"curve_noise/{event.model}/{output}": noise for output, noise in event.noise.items()}
            for output, lengths in event.length_scales.items():
                values |= {f"curve_length_scale/{event.model}/{output}/{feature}": x for feature, x in lengths.items()}
            if event.loss:
                values[f"curve_loss/{event.model}"] = statistics.fmean(event.loss.values())
            if event.coverage is not None and event.negative_log_density is not None:
                values[f"curve_coverage/{event.model}"] = event.coverage
                values[f"curve_negative_log_density/{event.model}"] = event.negative_log_density
            self._log(values, event.trained_on, {"trained_on": event.trained_on})
        elif isinstance(event, LimitsEstimated):
            limits = event.limits
            names = {"law": limits.base, "ceiling": limits.ceiling, "rigid_bound": limits.bound}
            self.scalars({f"limits/mass_error/{name}": error for name, error in names.items()})
        elif isinstance(event, EffectsFound):
            for missing in event.effects:
                margins = [(parameter, Z_95 * parameter.standard_error) for parameter in missing.parameters]
                tag = f"effect/{missing.effect.name}"
                self.scalars({f"{tag}/{p.name}": Interval(p.value, p.value - x, p.value + x) for p, x in margins})

    def scalars(
        self,
        values: Mapping[str, float | Interval],
        trained_on: int | None = None,
    ) -> None:
        """Log values by tag, such as `mass_error/whittaker`, at a number of training impacts; by default the run's."""
        step = self._trained_on if trained_on is None else trained_on
        self._log(values, step, {"trained_on": step})

    def series(self, tag: str, values: Iterable[float | Interval]) -> None:
        """Log a value for each rung of a ladder; its x axis is the rung."""
        for step, value in enumerate(values):
            self._log({tag: value}, step, {"trained_on": self._trained_on, "rung": step})

    def histogram(self, tag: str, values: Float[Tensor, "..."], trained_on: int | None = None) -> None:
        """Log the distribution of values; TensorBoard draws those of several numbers of training impacts in a row."""
        step = self._trained_on if trained_on is None else trained_on
        numbers = values.flatten().numpy()
        drawn = summary.histogram(tag, numbers, bin_edges(numbers, _BINS)).value[0]
        self._add(Summary(value=[_headed(tag, drawn)]), step)

    def figure(self, tag: str, png: bytes) -> None:
        """Log a picture as it is; `add_image` would encode it again, which takes longer than all else."""
        width, height = struct.unpack(">II", png[16:24])
        image = Summary.Image(height=height, width=width, colorspace=4, encoded_image_string=png)
        self._add(Summary(value=[_headed(tag, Summary.Value(image=image))]), self._trained_on)

    def card(self, about: Mapping[str, str], tables: Iterable[Sequence[Sequence[str]]]) -> None:
        """Log statements by name, and tables below them, the first row of each its header; no text is taken as markup.

        A table of the statements would get a column that is too narrow for their names.
        """
        parts = ["\n\n".join(f"**{_escaped(name)}:** {_escaped(text)}" for name, text in about.items())]
        for table in tables:
            header, *rows = (f"| {' | '.join(map(_escaped, row))} |" for row in table)
            parts.append("\n".join((header, "|---" * len(table[0]) + "|", *rows)))
        content = TensorProto(dtype=DT_STRING, string_val=["\n\n&nbsp;\n\n".join(parts).encode()])
        content.tensor_shape.dim.add().size = 1
        known = text.create_summary_metadata(SUMMARY, "What was run and found: command, data, equations and errors.")
        self._add(Summary(value=[Summary.Value(tag=SUMMARY, tensor=content, metadata=known)]), self._trained_on)

    def hyperparameters(
        self, values: Mapping[str, bool | float | str], choices: Mapping[str, Sequence[str]], metrics: Mapping[str, str]
    ) -> None:
        """Log the hyperparameters of the run, and the metrics to compare runs by, once the run has ended without error.

        The table under HParams thus has no run that was stopped.
        TensorBoard lists the names and choices of any one run for all of them: they must be the same in every run.

        Args:
            values: by name.
            choices: of the strings that are among a few.
            metrics: name in the table of hyperparameters by tag of a scalar.
        """
        start, infos = SessionStartInfo(), []
        for name, value in values.items():
            attribute, kind = _KINDS.get(type(value), _NUMBER)
            setattr(start.hparams[name], attribute, value)
            # TensorBoard first shows those that are marked as differing.
            infos.append(api_pb2.HParamInfo(name=name, type=kind, differs=name in _SHOWN))
            infos[-1].domain_discrete.extend([False, True] if isinstance(value, bool) else choices.get(name, ()))
        named = [
            api_pb2.MetricInfo(name=api_pb2.MetricName(tag=tag), display_name=name) for tag, name in metrics.items()
        ]
        end = SessionEndInfo(status=api_pb2.STATUS_SUCCESS)
        for tag, content in (
            (metadata.EXPERIMENT_TAG, {"experiment": api_pb2.Experiment(hparam_infos=infos, metric_infos=named)}),
            (metadata.SESSION_START_INFO_TAG, {"session_start_info": start}),
            (metadata.SESSION_END_INFO_TAG, {"session_end_info": end}),
        ):
            about = metadata.create_summary_metadata(HParamsPluginData(**content))
            value = Summary.Value(tag=tag, metadata=about, tensor=metadata.NULL_TENSOR)
            self._settings.append(Summary(value=[value]))

    def _log(self, values: Mapping[str, float | Interval], step: int, place: Mapping[str, int]) -> None:
        """Log values at a step; their line in metrics.jsonl begins with its place."""
        numbers = {}
        for tag, value in values.items():
            if isinstance(value, Interval):
                several = zip((tag, *ends(tag)), value, strict=True)
                numbers |= {name: number for name, number in several if not math.isnan(number)}
            else:
                numbers[tag] = value
        written = [
            # TensorBoard forgets the metadata of simple values.
            _headed(tag, Summary.Value(tensor=TensorProto(dtype=DT_FLOAT, float_val=[x]), metadata=_SCALARS))
            for tag, x in numbers.items()
            if self._shown.fullmatch(tag)
        ]
        self._add(Summary(value=written), step)
        with (self._folder / METRICS_FILE).open("a", encoding="utf-8") as lines:
            lines.write(json.dumps({**place, **numbers}) + "\n")

    def _add(self, content: Summary, step: int) -> None:
        self._file.write(event_pb2.Event(summary=content, step=step))


def _headed(tag: str, value: Summary.Value) -> Summary.Value:
    """A value as TensorBoard shows it: with its heading and description."""
    value.tag, value.metadata.summary_description = _heading(tag)
    value.metadata.display_name = value.tag.rpartition("/")[2]
    return value


def _escaped(text: str) -> str:
    """Escape text to one line without markup of Markdown, HTML or tables."""
    return re.sub(r"[!-/:-@\[-`{-~]", lambda sign: f"&#{ord(sign[0])};", " ".join(text.split()))
