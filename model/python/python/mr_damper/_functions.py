"""The commands as functions."""

import json
import os
from typing import Any, List, Union

from mr_damper import _native
from mr_damper._model import DamperModel, Progress, callback
from mr_damper._options import LOAD_OPTIONS, words
from mr_damper._results import Closing, Comparison, Evaluation
from mr_damper._runs import read_runs


def identify(runs: Any, model: str = "fuzzy-tanh", *, validate: Any = None, progress: Progress = None, **options: Any) -> DamperModel:
    """Identify a model: ``DamperModel(model, **options).fit(runs, validate=validate)``."""
    return DamperModel(model, **options).fit(runs, validate=validate, progress=progress)


def evaluate(model: Union[DamperModel, str, "os.PathLike[str]"], runs: Any, **options: Any) -> Evaluation:
    """The errors of a model on runs with measured force, as ``mr-damper evaluate`` reports them.

    Args:
        model: a :class:`DamperModel`, a model file, or a preset.
        runs: one run or a list of runs; see :func:`mr_damper.read_runs`, whose ``options`` are taken.

    Returns:
        RMSE in newtons (``rsse_n``) and NMSE (``esr``) for each run, and over all runs that the model was not made with.
    """
    given = model if isinstance(model, DamperModel) else DamperModel.load(model)
    name = given.model if isinstance(model, DamperModel) else os.fspath(model)
    text = _native.evaluate(given._fitted(), name, read_runs(runs, name="runs", **options))
    return Evaluation(json.loads(text))


def close(
    base: Union[DamperModel, str, "os.PathLike[str]"] = "auto",
    *,
    estimate: Any,
    confirm: Any,
    test: Any = None,
    reference: Any = None,
    replicates: Any = None,
    healthy: Any = None,
    progress: Progress = None,
    **options: Any,
) -> Closing:
    """Find the physical effects that a model lacks, add them, and report the error before and after, as ``mr-damper close`` does.

    Args:
        base: a :class:`DamperModel`, a model file, a preset, the name of a structure, or ``"auto"``.
        estimate: training runs, on which effects are searched.
        confirm: validation runs: an effect must reduce the error on every one of them.
        test: test runs, read once at the end.
        reference: healthy runs with the same excitation, one for each run in the order estimate, confirm, test.
        replicates: two or more runs of one pattern, for the noise floor.
        healthy: runs of the same damper when it was healthy; they tell whether an effect or a term is new.
        progress: as in :meth:`DamperModel.fit`.
        options: as on the command line: ``fixed_base``, ``noise_floor`` (N), ``block_s``, ``effects`` (list of ids), ``range`` (dict of id and
            ``(low, high)``), ``terms``, ``passive``, ``restarts``, ``seed``, the conditioning (``filter``, ``cutoff``, ...), and how runs are read.

    Returns:
        The verdict, the effects with intervals, and :attr:`Closing.model`.

    Raises:
        Error: when the diagnosis is refused; ``code`` and ``fields`` say why.
    """
    load = _load_options(options)
    given = dict(estimate=estimate, confirm=confirm, test=test, reference=reference, replicates=replicates, healthy=healthy)
    roles = [(role, read_runs(runs, name=role, **load)) for role, runs in given.items() if runs is not None]
    native = None
    if isinstance(base, DamperModel):
        native = base._fitted()
    else:
        options = {"base": os.fspath(base), **options}
    document, page, text, model = _native.close(words(options), native, roles, callback(progress))
    data = json.loads(document)
    # The command names the file that it writes; this function writes none.
    data.pop("model_file", None)
    return Closing(data, page, text, None if model is None else DamperModel._of(model))


def compare(train: Any = None, test: Any = None, *, runs_dir: Any = None, progress: Progress = None, **options: Any) -> Comparison:
    """Identify models and test them on other runs, as ``mr-damper compare`` does.

    Args:
        train: runs on which each model is identified, all together.
        test: runs on which each model is tested.
        runs_dir: in place of these, a folder with runs: each model is identified on every experiment and tested on all others.
        progress: as in :meth:`DamperModel.fit`.
        options: as on the command line: ``models`` (list of names), ``passive_only``, ``semi_active_only``, ``free_sets``, ``experiments``,
            ``pictures``, ``degree``, ``restarts``, ``seed``, ``most_rows``, ``resume`` (file that keeps finished work), the conditioning, and how
            runs are read.
    """
    load = _load_options(options)
    if runs_dir is not None:
        options = {**options, **load}
    line = words(options)
    if runs_dir is not None:
        line.append(os.fspath(runs_dir))
    training = [] if train is None else read_runs(train, name="train", **load)
    tests = [] if test is None else read_runs(test, name="test", **load)
    document, page, text = _native.compare(line, training, tests, callback(progress))
    return Comparison(json.loads(document), page, text)


def simulate(experiment: str, **options: Any) -> List["_native.Run"]:
    """Runs of the virtual rig, as ``mr-damper simulate`` writes them.

    Args:
        experiment: a name that ``mr-damper simulate --list`` lists (``"RP3-CS"``, ``"sine"``, ...), ``"all"`` or ``"paper1"``.
        options: as on the command line: ``replicates``, ``seed``, ``effect`` (dict of id and size), ``plain``, ``same_pattern``, ``steady``,
            ``perfect``, ``force_noise`` (N), ``duration`` (s), ``amplitude`` (m), ``frequency`` (Hz), ``to_frequency`` (Hz), ``current`` (A).

    Returns:
        One run for each replicate, at 512 Hz.
    """
    return _native.simulate(words({"experiment": experiment, **options}))


def _load_options(options: Any) -> Any:
    """Takes the options that say how runs are read out of ``options``."""
    return {name: options.pop(name) for name in LOAD_OPTIONS if name in options}
