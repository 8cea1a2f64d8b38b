"""A simulated fleet on a local Dask cluster of two workers, one of which is killed midway.

    python model/python/benches/fleet.py [--dampers 1000] [--days 30] [--folder DIR] [--seed 1]

Each damper records 50 s a day at 100 Hz, on another road and at another current each day. Its force is that of one preset, and the model that
follows it is another preset, which misses it by about 15 N. One damper in 20 ages: its force fades by 6 to 20 %, at once or evenly, from a day in
the first half on. It prints the times, what was lost or done twice (nothing), which aged dampers were found, and the false alarms.
"""

import argparse
import concurrent.futures
import datetime
import json
import os
import pathlib
import signal
import tempfile
import time

import duckdb
import numpy as np
from dask.distributed import Client, LocalCluster

import mr_damper
from mr_damper import fleet

TRUTH, MODEL = "thesis/fuzzy-tanh/rp2-cs", "thesis/fuzzy-tanh/rp3-cs"
BEGIN = datetime.date(2026, 10, 1)
RATE_HZ, DURATION_S, NOISE_N = 100.0, 50.0, 5.0


def ageing(rng, days):
    """The ratio of a damper's force on each day, or None for a damper that does not age."""
    if rng.random() >= 0.05:
        return None
    fade, first, at_once = rng.uniform(0.06, 0.20), rng.integers(days // 5, days // 2 + 1), rng.random() < 0.5
    share = np.ones(days - first) if at_once else np.linspace(0.0, 1.0, days - first)
    return np.concatenate([np.ones(first), 1.0 - fade * share])


def record(number, days, seed, folder):
    """The recordings of a damper. Returns the ratio of its force on the last day."""
    rng = np.random.default_rng([seed, number])
    aged = ageing(rng, days)
    model = mr_damper.DamperModel.load(TRUTH)
    where = pathlib.Path(folder, f"D{number:04}")
    where.mkdir(parents=True)
    at_s = np.arange(int(DURATION_S * RATE_HZ)) / RATE_HZ
    for day in range(days):
        # A road: 40 sines with falling amplitudes, scaled to a stroke; a current that is held for a time.
        hz = rng.uniform(0.3, rng.uniform(3.0, 5.0), 40)
        road = (np.sin(2.0 * np.pi * (np.outer(at_s, hz) + rng.random(40))) / hz).sum(axis=1)
        displacement_m = road * rng.uniform(0.004, 0.009) / road.std()
        steps = rng.uniform(0.0, rng.uniform(0.8, 2.0), 64)
        current_a = np.repeat(steps, len(at_s) // 64 + 1)[: len(at_s)]
        begin = datetime.datetime.combine(BEGIN + datetime.timedelta(days=day), datetime.time(8), datetime.timezone.utc)
        table = {
            "time_ns": np.round(at_s * 1e9).astype("i8") + int(begin.timestamp()) * 10**9,
            "displacement_m": displacement_m + rng.normal(0.0, 5e-6, len(at_s)),
            "current_a": current_a,
        }
        run = mr_damper.read_run(table, map={"time": "time_ns,unit=ns"})
        ratio = 1.0 if aged is None else aged[day]
        table["force_n"] = ratio * np.nan_to_num(model.predict(run)) + rng.normal(0.0, NOISE_N, len(at_s))
        mr_damper.read_run(table, map={"time": "time_ns,unit=ns"}).save(where / f"{begin:%Y%m%d}.csv")
    return 1.0 if aged is None else float(aged[-1])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dampers", type=int, default=1000)
    parser.add_argument("--days", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=pathlib.Path, default=None, help="keep recordings and results here")
    args = parser.parse_args()
    folder = args.folder or pathlib.Path(tempfile.mkdtemp())
    began = time.monotonic()
    known = folder / "truth.json"
    if not known.exists():
        with concurrent.futures.ProcessPoolExecutor(2) as pool:
            jobs = [pool.submit(record, number, args.days, args.seed, folder / "in") for number in range(args.dampers)]
            truth = {f"D{number:04}": job.result() for number, job in enumerate(jobs)}
        known.write_text(json.dumps(truth))
        print(f"recorded {args.dampers} dampers x {args.days} days in {time.monotonic() - began:.0f} s", flush=True)
    truth = json.loads(known.read_text())

    recordings = fleet.find(folder / "in", r"(?P<damper>D\d+)/(?P<day>\d{8})")
    out = folder / "out"
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster, Client(cluster) as client:
        workers = sorted(client.run(os.getpid).values())

        def progress(done, of):
            if done == of // 2:
                os.kill(workers[0], signal.SIGKILL)
                print(f"killed a worker after {done} of {of} tasks", flush=True)

        began = time.monotonic()
        outcome = fleet.effect_values(recordings, MODEL, out, window=48.0, engine=client, progress=progress)
        took = time.monotonic() - began
        print(f"{outcome} in {took:.0f} s: {len(recordings) / took:.0f} recordings a second", flush=True)
        began = time.monotonic()
        print(f"once more: {fleet.effect_values(recordings, MODEL, out, window=48.0, engine=client)} in {time.monotonic() - began:.0f} s")

    began = time.monotonic()
    rows = fleet.read(out, "values", ["damper", "day", "parameter"])
    took = time.monotonic() - began
    different = len(rows.group_by(rows.column_names).aggregate([]))
    print(f"{len(rows)} rows of {len(recordings)} recordings, {different} different, read in {took:.1f} s")
    began = time.monotonic()
    found = fleet.ageing(out)
    print(f"{found} in {time.monotonic() - began:.1f} s")
    began = time.monotonic()
    query = f"select damper from '{out}/ageing.parquet' where parameter = 'force_ratio' and changed and change_percent < -5"
    fading = {damper for (damper,) in duckdb.sql(query).fetchall()}
    print(f"which dampers fade by more than 5 %: {len(fading)} in {time.monotonic() - began:.3f} s")
    aged = {damper for damper, ratio in truth.items() if ratio < 1.0}
    noticed = {row["damper"] for row in found.rows if row["changed"]}
    healthy_days = args.days * (len(truth) - len(aged))
    print(f"aged: {len(aged)}, noticed: {len(noticed & aged)}, named by the query: {len(fading & aged)}, named in error: {len(fading - aged)}")
    print(f"false alarms: {len(noticed - aged)} in {healthy_days} damper-days, allowed {healthy_days / 1000:.0f}")
    missed = sorted((round(truth[damper], 3), damper) for damper in aged - noticed)
    print(f"not noticed (ratio on the last day): {missed}")
    found.save(folder / "fleet.html")


if __name__ == "__main__":
    main()
