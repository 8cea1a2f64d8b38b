"""The estimator ``DamperModel``."""

import inspect
import json
import os
from decimal import ROUND_HALF_UP, Decimal
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Union

from mr_damper import _native
from mr_damper._errors import Error, NotFittedError, UsageError, warn
from mr_damper._options import LOAD_OPTIONS, words, without_load
from mr_damper._results import EffectValues, Evaluation, FitResult, Prediction
from mr_damper._runs import read_runs

Progress = Union[bool, Callable[[str, int, int], None], None]


class Step(NamedTuple):
    """The estimate at one displacement; a value that does not exist is NaN."""

    estimate_n: float
    """Force that the node would publish, N."""
    simulation_n: float
    """Force of the simulation, from displacement and drive alone, N."""
    one_step_n: float
    """One-step-ahead prediction, N."""
    band_low_n: float
    """Lower end of the 90 % band, N."""
    band_high_n: float
    """Upper end of the 90 % band, N."""
    measured_n: float
    """Measured force, filtered like the model's output, N."""
    residual_n: float
    """Measured minus simulated reading of the load cell, N."""
    band_calibrated: bool
    """True if the band comes from a calibration."""
    mode: str
    """Source of the estimate: ``arx``, ``arx_coast``, ``model``, ``hold`` or ``fault``."""
    validity: str
    """How far the estimate can be trusted: ``VALID``, ``DEGRADED``, ``EXTRAPOLATING``, ``STALE`` or ``INVALID``."""
    reasons: str
    """Why it is not valid, joined by ``|``."""


class DamperModel:
    """A force model of a magneto-rheological damper, in the conventions of scikit-learn.

    A sample is a run, not a row: ``fit``, ``predict`` and ``score`` take one run or a list of runs; see :func:`mr_damper.read_runs`.

    Args:
        model: structure (``"fuzzy-tanh"``, ``"sp"``, ``"arx"``, ``"kwok"``, ``"anfis"``, ...; ``mr-damper identify --help`` lists all).
        passive: identify the form without the drive.
        fuzzy: use fuzzy sets over the drive in place of polynomials (force laws, lpv).
        degree: degree of the polynomials over the drive, 1 to 5.
        fit_variant: fit as in the model's publication (``"pso"``, ``"rls"``, ``"ga"``, ``"back-propagation"``); ``--fit`` of the command.
        inverse: also identify an inverse model of this kind.
        huber: threshold of Huber's loss, N; by default squares are minimised.
        restarts: random starting points of a nonlinear fit.
        seed: seed of the starting points.
        centres: centres of the fuzzy sets, A or V.
        sigma: standard deviation of the fuzzy sets, A or V; needs ``centres``.
        sets: number of fuzzy sets.
        free_sets: also identify the centres and widths of the fuzzy sets.
        filter: where the low-pass filter is applied: ``"inputs"``, ``"output"`` or ``"none"``.
        cutoff: corner frequency of the filter, Hz.
        velocity: source of velocity: ``"backward"``, ``"three-point"``, ``"slope"`` or ``"measured"``; by default the one that fits best.
        slope_window: window of the slope, s.
        rate: rate of the rows, Hz, reached by keeping every n-th sample.
        all_samples: use all samples, not only those in which the damper moves.
        skip_bad_rows, thesis_txt, drive, bag_namespace, bag_joint, dbc, map, column, sign, map_file: how runs are read; see :func:`mr_damper.read_runs`.

    Attributes:
        model_: the identified model (native; immutable).
        result_: figures of the fit (:class:`FitResult`); ``None`` for a model that was loaded.
    """

    model: str
    model_: "_native.Model"
    result_: Optional[FitResult]

    def __init__(
        self,
        model: str = "fuzzy-tanh",
        *,
        passive: bool = False,
        fuzzy: bool = False,
        degree: int = 2,
        fit_variant: Optional[str] = None,
        inverse: Optional[str] = None,
        huber: Optional[float] = None,
        restarts: int = 25,
        seed: int = 0,
        centres: Optional[Sequence[float]] = None,
        sigma: Optional[float] = None,
        sets: Optional[int] = None,
        free_sets: bool = False,
        filter: Optional[str] = None,
        cutoff: Optional[float] = None,
        velocity: Optional[str] = None,
        slope_window: Optional[float] = None,
        rate: Optional[float] = None,
        all_samples: bool = False,
        skip_bad_rows: bool = False,
        thesis_txt: bool = False,
        drive: Optional[str] = None,
        bag_namespace: Optional[str] = None,
        bag_joint: Optional[str] = None,
        dbc: Any = None,
        map: Any = None,
        column: Any = None,
        sign: Any = None,
        map_file: Union[str, "os.PathLike[str]", None] = None,
    ) -> None:
        for name, value in list(locals().items()):
            if name != "self":
                setattr(self, name, value)

    # scikit-learn

    @classmethod
    def _parameter_names(cls) -> List[str]:
        return [name for name in inspect.signature(cls.__init__).parameters if name != "self"]

    def get_params(self, deep: bool = True) -> Dict[str, Any]:
        """The options by name."""
        return {name: getattr(self, name) for name in self._parameter_names()}

    def set_params(self, **params: Any) -> "DamperModel":
        """Change options. The fitted model stays until the next ``fit``."""
        known = self._parameter_names()
        for name, value in params.items():
            if name not in known:
                raise UsageError(f"{name!r} is not an option of DamperModel; options are {', '.join(known)}", "usage", {"name": name})
            setattr(self, name, value)
        return self

    def __sklearn_tags__(self) -> Any:
        from sklearn.utils import (  # type: ignore[import-untyped, unused-ignore]
            InputTags,
            RegressorTags,
            Tags,
            TargetTags,
        )

        return Tags(
            estimator_type="regressor",
            target_tags=TargetTags(required=False),
            regressor_tags=RegressorTags(),
            input_tags=InputTags(two_d_array=False),
        )

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "model_")

    def __repr__(self) -> str:
        defaults = inspect.signature(type(self).__init__).parameters
        shown = [repr(self.model)]
        shown += [f"{name}={value!r}" for name, value in self.get_params().items() if name != "model" and value != defaults[name].default]
        return f"DamperModel({', '.join(shown)})"

    # identification

    def fit(self, runs: Any, y: Any = None, *, validate: Any = None, progress: Progress = None) -> "DamperModel":
        """Identify the model.

        Args:
            runs: training runs, fitted together; each has its own force offset. The runs need displacement, force and, unless ``passive``,
                the drive.
            y: must be ``None``: the force is a channel of the runs.
            validate: validation runs, which are not fitted. Their error becomes the model's expected error, and they calibrate its 90 % band.
            progress: ``True`` writes progress to stderr; a function receives the stage, the steps done and their number (0: unknown).

        Returns:
            This object. The global lock is released while the fit runs, and Ctrl-C ends the fit.

        Raises:
            Error: the runs do not load, or the model cannot be identified from them.
        """
        if y is not None:
            raise UsageError("y is given, but the force is a channel of the runs (force_n); leave y out", "usage", {"name": "y"})
        training = self._runs(runs, "runs")
        held_out = [] if validate is None else self._runs(validate, "validate")
        found = _native.identify(self._words(), training, held_out, callback(progress))
        self.model_ = found.model
        self.result_ = FitResult(json.loads(found.to_json()), found)
        self.__dict__.pop("_stepper", None)
        for warning in self.result_.warnings:
            warn(warning)
        return self

    def _words(self) -> List[str]:
        options = without_load(self.get_params())
        options["fit"] = options.pop("fit_variant")
        return words(options)

    def _runs(self, runs: Any, name: str) -> List["_native.Run"]:
        return read_runs(runs, name=name, **{option: getattr(self, option) for option in LOAD_OPTIONS})

    # use

    def predictions(self, run: Any) -> Any:
        """Everything that the model says of each displacement of a run: see :class:`Prediction`. A list of runs gives a list."""
        return self._each(run, lambda one: Prediction(self._fitted().predict(one)))

    def predict(self, run: Any, *, steps_ahead: Optional[int] = None) -> Any:
        """The force at each displacement of a run, N.

        Args:
            run: a run, or a list of runs, which gives a list.
            steps_ahead: by default the simulation, from displacement and drive alone; 1 for the one-step-ahead prediction of a model that
                uses measured force (arx).

        Returns:
            One-dimensional array of float64 with one force for each displacement, in newtons, positive in tension; NaN where the model has
            no force (such as before the drive is known).
        """
        if steps_ahead not in (None, 1):
            raise UsageError(
                f"steps_ahead is {steps_ahead!r}; give 1, or leave it out for the simulation", "usage", {"name": "steps_ahead"}
            )
        model = self._fitted()
        if steps_ahead == 1 and not model.feeds_on_force:
            raise UsageError(
                f"steps_ahead=1 needs a model that predicts from measured force (arx), but {model.name} does not use it; "
                "leave steps_ahead out",
                "usage",
                {"name": "steps_ahead", "model": model.name},
            )
        column = "simulation_n" if steps_ahead is None else "one_step_n"
        return self._each(run, lambda one: getattr(Prediction(model.predict(one)), column))

    def effect_values(self, runs: Any, *, window: float = 60.0) -> EffectValues:
        """The ratio of measured to expected force, and the values of the model's effects, over time: what a node with ``effects.track`` publishes.

        Args:
            runs: runs of one damper with measured force. They share windows, in the order of their times.
            window: length of a window, s, at least 48. Time without a residual does not count.
        """
        return EffectValues(self._fitted().effect_values(self._runs(runs, "runs"), float(window)))

    def evaluate(self, runs: Any) -> Evaluation:
        """The errors on runs with measured force; see :func:`mr_damper.evaluate`."""
        return Evaluation(json.loads(_native.evaluate(self._fitted(), self.model, self._runs(runs, "runs"))))

    def score(self, runs: Any, y: Any = None) -> float:
        """1 - NMSE of the simulation over all samples with measured force: 1 for a perfect model, 0 for one that predicts the mean.

        Several runs are pooled: the squared errors of all samples over the variance within each run.
        """
        if y is not None:
            raise UsageError("y is given, but the force is a channel of the runs (force_n); leave y out", "usage", {"name": "y"})
        squares = spread = 0.0
        for row in self.evaluate(runs).runs:
            if row.free_run is None:
                return float("-inf")
            square = row.free_run.samples * row.free_run.rsse_n**2
            squares += square
            spread += square / row.free_run.esr if row.free_run.esr > 0.0 else 0.0
        return 1.0 - squares / spread if spread > 0.0 else 1.0

    def step(
        self,
        time_s: Optional[float] = None,
        *,
        time_ns: Optional[int] = None,
        displacement_m: Optional[float] = None,
        current_a: Optional[float] = None,
        command_v: Optional[float] = None,
        force_n: Optional[float] = None,
        velocity_m_s: Optional[float] = None,
        case_temp_c: Optional[float] = None,
    ) -> Optional[Step]:
        """Take the readings of one instant, as a live node does, and return the estimate that they cause.

        Args:
            time_s: time of the readings, s, from any epoch. It must not decrease.
            time_ns: the same in whole nanoseconds, exact at any epoch.
            displacement_m, current_a, command_v, force_n, velocity_m_s, case_temp_c: the readings of this instant.

        Returns:
            The estimate; ``None`` without displacement. A reading that is refused (NaN, a stamp that repeats) gives a warning, and is
            reported in ``reasons`` of the next estimate.
        """
        if (time_s is None) == (time_ns is None):
            raise UsageError("give the time of the readings either as time_s or as time_ns", "usage", {"name": "time_s"})
        stamp = nanoseconds(time_s) if time_ns is None else int(time_ns)
        stepper = self.__dict__.get("_stepper")
        if stepper is None:
            stepper = self._stepper = _native.Stepper(self._fitted())
        row, refused = stepper.step(stamp, displacement_m, velocity_m_s, force_n, current_a, command_v, case_temp_c)
        for why in refused:
            warn(f"a reading at {stamp / 1e9:.9f} s is refused: {why}")
        return None if row is None else Step(*row[0], *row[1:])

    def reset(self) -> None:
        """Forget all steps: the next ``step`` begins a new run."""
        self.__dict__.pop("_stepper", None)

    @property
    def parameters(self) -> Dict[str, Any]:
        """The table ``[parameters]`` of the model file: coefficients by name, with units in the names."""
        return self.to_dict().get("parameters", {})  # type: ignore[no-any-return]

    def to_dict(self) -> Dict[str, Any]:
        """The content of the model file."""
        return json.loads(self._fitted().to_json())  # type: ignore[no-any-return]

    # files

    def save(self, path: Union[str, "os.PathLike[str]"]) -> None:
        """Write the model file, the same as ``mr-damper identify --out`` writes.

        If the name ends in ``.fis``, the FIS file of MATLAB is written, for models of fuzzy rules (``--fis``).
        """
        self._fitted().save(os.fspath(path))

    @classmethod
    def load(cls, name: Union[str, "os.PathLike[str]"]) -> "DamperModel":
        """The model in a file, or a preset such as ``"thesis/fuzzy-tanh/rp3-cs"`` (``mr-damper presets`` lists them)."""
        return cls._of(_native.Model.load(os.fspath(name)))

    @classmethod
    def _of(cls, native: "_native.Model") -> "DamperModel":
        model = cls(native.name)
        model.model_ = native
        model.result_ = None
        return model

    def __getstate__(self) -> Dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_stepper"}

    def _fitted(self) -> "_native.Model":
        try:
            return self.__dict__["model_"]  # type: ignore[no-any-return]
        except KeyError:
            raise NotFittedError("this DamperModel has no model yet; call fit, or use DamperModel.load", "not_fitted") from None

    def _each(self, runs: Any, work: Callable[[Any], Any]) -> Any:
        from mr_damper._runs import is_one

        self._fitted()
        read = self._runs(runs, "run")
        return work(read[0]) if is_one(runs) else [work(one) for one in read]


def nanoseconds(time_s: Any) -> int:
    """A time in whole nanoseconds: the shortest decimal text of the float counts, as in CSV files."""
    try:
        return int(Decimal(repr(float(time_s))).scaleb(9).to_integral_value(ROUND_HALF_UP))
    except (ValueError, OverflowError, ArithmeticError):
        raise Error(f"time_s is {time_s!r}; give a finite time in seconds", "time", {"value": time_s}) from None


def callback(progress: Progress) -> Optional[Callable[[str, int, int], None]]:
    """The function that receives progress; ``None`` if there is none."""
    if progress is True:
        return _to_stderr
    return progress or None


def _to_stderr(stage: str, done: int, of: int) -> None:
    import sys

    text = f"{stage} {done}/{of}" if of else stage
    end = "\n" if of and done == of else ""
    print(f"\r{text:<60.60}", end=end, file=sys.stderr, flush=True)
