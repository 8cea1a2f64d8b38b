"""The native module. Use the classes and functions of ``mr_damper``; this module may change."""

from os import PathLike
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple, Union, final

_Path = Union[str, PathLike[str]]
_Progress = Optional[Callable[[str, int, int], None]]

__version__: str

@final
class Run:
    """A recorded run. Runs are immutable and may be shared between threads."""

    @staticmethod
    def read(path: _Path, options: List[str]) -> Run: ...
    @staticmethod
    def from_columns(name: str, columns: Sequence[Tuple[str, str, Any]], options: List[str]) -> Run: ...
    @staticmethod
    def from_arrow(name: str, table: Any, options: List[str]) -> Run: ...
    @staticmethod
    def from_traces(name: str, sha256: bytes, drive: Optional[str], traces: Sequence[Tuple[str, bytes, bytes]]) -> Run: ...
    def save(self, path: _Path) -> None:
        """Write a .csv, .mcap or .db3 file, or a new directory for a rosbag2 bag."""
    @property
    def name(self) -> str:
        """The path of the run, or the name of the table."""
    @property
    def drive(self) -> Optional[str]:
        """``"current_a"``, ``"command_v"``, or ``None`` if neither was recorded."""
    @property
    def duration_s(self) -> float:
        """Duration of the displacement, s."""
    @property
    def rate_hz(self) -> Optional[float]:
        """Mean rate of the displacement, Hz."""
    @property
    def channels(self) -> List[str]:
        """Names of the channels, in SI units."""
    @property
    def sha256(self) -> str:
        """SHA-256 of the file; for a table, of the CSV file that :meth:`save` writes."""
    @property
    def notes(self) -> List[str]:
        """Facts about reading the run."""
    def traces(self) -> Dict[str, Tuple[bytes, bytes]]:
        """Stamps (ns, int64) and values (float64, SI units) of each channel as bytes, for ``numpy.frombuffer``."""
    def __len__(self) -> int:
        """Number of displacements."""

@final
class Model:
    @staticmethod
    def load(name: str) -> Model: ...
    @staticmethod
    def from_toml(text: str) -> Model: ...
    def to_toml(self) -> str: ...
    def to_json(self) -> str: ...
    def save(self, path: _Path) -> None: ...
    @property
    def name(self) -> str: ...
    @property
    def drive(self) -> Optional[str]: ...
    @property
    def rate_hz(self) -> float: ...
    @property
    def feeds_on_force(self) -> bool: ...
    @property
    def parameter_count(self) -> int: ...
    def predict(self, run: Run) -> Dict[str, Any]: ...
    def effect_values(self, runs: Sequence[Run], window_s: float) -> Dict[str, Any]: ...

@final
class Stepper:
    def __new__(cls, model: Model) -> Stepper: ...
    def step(
        self,
        time_ns: int,
        displacement_m: Optional[float] = None,
        velocity_m_s: Optional[float] = None,
        force_n: Optional[float] = None,
        current_a: Optional[float] = None,
        command_v: Optional[float] = None,
        case_temp_c: Optional[float] = None,
    ) -> Tuple[Optional[Tuple[List[float], bool, str, str, str]], List[str]]: ...

@final
class Identification:
    @property
    def model(self) -> Model: ...
    @property
    def remarks(self) -> List[str]: ...
    def to_json(self) -> str: ...
    def html(self) -> str: ...

def main(arguments: List[str]) -> int: ...
def identify(words: List[str], runs: Sequence[Run], validate: Sequence[Run], progress: _Progress) -> Identification: ...
def evaluate(model: Model, name: str, runs: Sequence[Run]) -> str: ...
def close(
    words: List[str], base: Optional[Model], runs: Sequence[Tuple[str, Sequence[Run]]], progress: _Progress
) -> Tuple[str, str, str, Optional[Model]]: ...
def compare(
    words: List[str], train: Sequence[Run], test: Sequence[Run], progress: _Progress
) -> Tuple[str, str, str]: ...
def simulate(words: List[str]) -> List[Run]: ...
def changes(
    values: List[float], halves: List[float], excitations: List[Tuple[float, float, float]], values_per_alarm: float
) -> List[bool]: ...
