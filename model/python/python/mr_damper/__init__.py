"""Force models of magneto-rheological (MR) dampers.

Identification from recorded runs, simulation and one-step-ahead prediction, diagnosis of missing physical effects, comparison of models,
and a virtual rig. All numbers are those of the command ``mr-damper``, which this package also installs.

    >>> import mr_damper
    >>> runs = mr_damper.simulate("RP3-CS", replicates=2, duration=10.0)
    >>> model = mr_damper.DamperModel("fuzzy-tanh", restarts=4).fit(runs[0], validate=runs[1])
    >>> force_n = model.predict(runs[1])

A positive displacement extends the damper, a positive force is tension on the rod. Units are in the names: ``force_n`` is in newtons.
"""

from mr_damper import _native
from mr_damper._errors import Error, MrDamperWarning, NotFittedError, UsageError
from mr_damper._functions import close, compare, evaluate, identify, simulate
from mr_damper._model import DamperModel, Step
from mr_damper._native import Run
from mr_damper._results import Closing, Comparison, EffectValues, Evaluation, FitResult, Prediction, Record
from mr_damper._runs import read_run, read_runs

__version__: str = _native.__version__

__all__ = [
    "Closing",
    "Comparison",
    "DamperModel",
    "EffectValues",
    "Error",
    "Evaluation",
    "FitResult",
    "MrDamperWarning",
    "NotFittedError",
    "Prediction",
    "Record",
    "Run",
    "Step",
    "UsageError",
    "close",
    "compare",
    "evaluate",
    "identify",
    "read_run",
    "read_runs",
    "simulate",
]
