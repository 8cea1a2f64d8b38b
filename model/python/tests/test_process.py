"""The command of the wheel, Ctrl-C, progress, and threads."""

import concurrent.futures
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

import mr_damper


def test_exit_codes_and_output_are_those_of_a_program(command):
    assert command("--version").stdout.startswith("mr-damper ")
    wrong = command("evaluate", check=False)
    assert (wrong.returncode, "Usage:" in wrong.stderr) == (2, True)
    failed = command("evaluate", "absent.toml", "absent.csv", check=False)
    assert (failed.returncode, "absent.toml" in failed.stderr) == (1, True)
    module = subprocess.run([sys.executable, "-m", "mr_damper", "presets"], capture_output=True, text=True, timeout=60)
    assert (module.returncode, "thesis/fuzzy-tanh/rp3-cs" in module.stdout) == (0, True)


def test_a_closed_pipe_ends_the_command(command):
    done = subprocess.run(["sh", "-c", f"'{command.program}' presets | head -1"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_command_in_an_orderly_way(command, files, tmp_path, signum):
    words = ["identify", "--model", "fuzzy-tanh", "--restarts", "2000", *files, "--out", tmp_path / "model.toml"]
    process = subprocess.Popen([command.program, *map(str, words)], stderr=subprocess.PIPE, text=True)
    time.sleep(1.0)
    process.send_signal(signum)
    _, stderr = process.communicate(timeout=30)
    assert (process.returncode, "interrupted" in stderr) == (1, True), stderr
    assert "Traceback" not in stderr
    assert not (tmp_path / "model.toml").exists()


def test_ctrl_c_ends_a_fit(files):
    # A shell starts background jobs with SIGINT ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        mr_damper.DamperModel("fuzzy-tanh", restarts=5000).fit(files)
    assert time.monotonic() - began < 10.0


def test_progress_is_called_and_its_exception_ends_the_fit(files, capfd):
    calls = []
    mr_damper.DamperModel("fuzzy-tanh", restarts=20).fit(files[0], progress=lambda *call: calls.append(call))
    assert calls
    for stage, done, of in calls:
        assert isinstance(stage, str) and 0 <= done <= max(of, done)

    def stop(stage, done, of):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        mr_damper.DamperModel("fuzzy-tanh", restarts=5000).fit(files, progress=stop)
    mr_damper.DamperModel("fuzzy-tanh", restarts=20).fit(files[0], progress=True)
    captured = capfd.readouterr()
    assert captured.out == ""
    assert "restarts" in captured.err or "conditioning" in captured.err or "final fit" in captured.err


def test_other_threads_run_during_a_fit(files):
    ticks = []
    ended = threading.Event()

    def tick():
        while not ended.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.005)

    thread = threading.Thread(target=tick)
    thread.start()
    began = time.monotonic()
    mr_damper.DamperModel("fuzzy-tanh", restarts=100).fit(files[:2])
    took = time.monotonic() - began
    ended.set()
    thread.join()
    during = [at for at in ticks if began <= at <= began + took]
    # With the lock held there would be none.
    assert len(during) > 10 * took


def test_four_threads_give_the_results_of_one(files):
    runs = mr_damper.read_runs(files)
    shared = mr_damper.DamperModel("fuzzy-tanh", restarts=2, sets=3).fit(runs[0])

    def work(number):
        model = mr_damper.DamperModel("sp", restarts=2, seed=number).fit(runs[number % 3])
        forces = shared.predict(runs[(number + 1) % 3])
        return model.parameters, forces.tobytes(), shared.evaluate(runs).to_dict()

    expected = [work(number) for number in range(8)]
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        assert list(pool.map(work, range(8))) == expected


def test_four_threads_may_share_a_stepper():
    model = mr_damper.DamperModel.load("thesis/fuzzy-tanh/rp3-cs")
    clock = iter(range(1, 1 << 30))
    lock = threading.Lock()

    def work(_):
        rows = []
        for _ in range(500):
            with lock:
                at = next(clock)
                rows.append(model.step(time_ns=at * 2_000_000, displacement_m=0.01, current_a=1.0))
        return rows

    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        rows = [row for part in pool.map(work, range(4)) for row in part]
    assert len(rows) == 2000 and all(row is not None for row in rows)


def test_the_demo_runs_from_the_wheel(command, tmp_path):
    words = ["demo", "--no-screen", "--seconds", "4", "--domain-id", "93", "--out", tmp_path / "demo"]
    done = command(*words)
    assert "report: " in done.stdout
    assert list((tmp_path / "demo").glob("*.html"))
