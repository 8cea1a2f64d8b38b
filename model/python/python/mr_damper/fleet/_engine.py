"""Where tasks run: in this process, on an executor of ``concurrent.futures``, on Dask, or on Ray."""

import concurrent.futures
import itertools
from typing import Any, Callable, Dict, Iterable, Iterator, List, Tuple, TypeVar

from mr_damper._errors import UsageError

Task = TypeVar("Task")

#: Tasks that wait for each processor, so that none is idle while results are collected.
_AHEAD = 4


def results(engine: Any, function: Callable[[Task], Any], tasks: Iterable[Task], retries: int) -> Iterator[Tuple[Task, Any]]:
    """Each task with the result of ``function``, or with the exception that it ended with, in the order in which they end.

    Only a few tasks for each processor are submitted at a time, so a million tasks need no more memory than ten. If the caller stops early,
    what was submitted is cancelled.
    """
    runner = _runner(engine, retries)
    most = max(_AHEAD * runner.processors(), 1)
    left = iter(tasks)
    waiting: Dict[Any, Task] = {}
    try:
        while True:
            for task in itertools.islice(left, most - len(waiting)):
                waiting[runner.submit(function, task)] = task
            if not waiting:
                return
            for handle in runner.wait(list(waiting)):
                yield waiting.pop(handle), runner.result(handle)
    finally:
        runner.cancel(list(waiting))


def _runner(engine: Any, retries: int) -> Any:
    if engine is None:
        return _Here()
    if isinstance(engine, concurrent.futures.Executor):
        return _Executor(engine)
    if any(base.__module__.partition(".")[0] == "distributed" for base in type(engine).__mro__):
        return _Dask(engine, retries)
    if getattr(engine, "__name__", None) == "ray":
        return _Ray(engine, retries)
    raise UsageError(
        f"engine is {engine!r:.80}; give a dask.distributed.Client, the module ray, an executor of concurrent.futures, or None",
        "usage",
        {"name": "engine"},
    )


class _Here:
    """One task after the other in this process. A handle is a pair of one."""

    def processors(self) -> int:
        return 1

    def submit(self, function: Callable[[Any], Any], task: Any) -> Any:
        future: "concurrent.futures.Future[Any]" = concurrent.futures.Future()
        try:
            future.set_result(function(task))
        except Exception as error:
            future.set_exception(error)
        return future

    def wait(self, handles: List[Any]) -> List[Any]:
        return handles

    def result(self, handle: Any) -> Any:
        return handle.exception() or handle.result()

    def cancel(self, handles: List[Any]) -> None:
        pass


class _Executor(_Here):
    """A pool of processes or threads. A process that dies ends the pool: what was written stays, and the next call goes on from there."""

    def __init__(self, executor: concurrent.futures.Executor) -> None:
        self._executor = executor

    def processors(self) -> int:
        return int(getattr(self._executor, "_max_workers", 1))

    def submit(self, function: Callable[[Any], Any], task: Any) -> Any:
        try:
            return self._executor.submit(function, task)
        except concurrent.futures.BrokenExecutor as error:
            raise type(error)(f"{error}. The results that were written stay: make a new pool, and call the function again") from error

    def wait(self, handles: List[Any]) -> List[Any]:
        return list(concurrent.futures.wait(handles, return_when="FIRST_COMPLETED").done)

    def cancel(self, handles: List[Any]) -> None:
        for handle in handles:
            handle.cancel()


class _Dask(_Here):
    """Dask runs the task of a worker that dies on another worker, and repeats a task that fails ``retries`` times."""

    def __init__(self, client: Any, retries: int) -> None:
        self._client, self._retries = client, retries

    def processors(self) -> int:
        return sum(self._client.nthreads().values())

    def submit(self, function: Callable[[Any], Any], task: Any) -> Any:
        return self._client.submit(function, task, pure=False, retries=self._retries)

    def wait(self, handles: List[Any]) -> List[Any]:
        from distributed import wait  # type: ignore[import-not-found, unused-ignore]

        return list(wait(handles, return_when="FIRST_COMPLETED").done)

    def cancel(self, handles: List[Any]) -> None:
        if handles:
            self._client.cancel(handles)


class _Ray(_Here):
    """Ray, as the module ``ray`` after ``ray.init()``. It repeats a task whose worker dies, or that fails, ``retries`` times."""

    def __init__(self, ray: Any, retries: int) -> None:
        self._ray, self._retries = ray, retries
        self._remote: Dict[Callable[[Any], Any], Any] = {}

    def processors(self) -> int:
        return int(self._ray.cluster_resources().get("CPU", 1))

    def submit(self, function: Callable[[Any], Any], task: Any) -> Any:
        if function not in self._remote:
            self._remote[function] = self._ray.remote(max_retries=self._retries, retry_exceptions=True)(function)
        return self._remote[function].remote(task)

    def wait(self, handles: List[Any]) -> List[Any]:
        return self._ray.wait(handles, num_returns=1)[0]  # type: ignore[no-any-return]

    def result(self, handle: Any) -> Any:
        try:
            return self._ray.get(handle)
        except Exception as error:
            return error

    def cancel(self, handles: List[Any]) -> None:
        for handle in handles:
            self._ray.cancel(handle)
