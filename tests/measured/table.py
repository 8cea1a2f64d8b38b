"""Prints the table of node/docs/guide/04-evaluate-and-compare.md from the comparisons of tests/measured/run.sh: errors in simulation
(free run) on held-out runs.

usage: table.py OUT
"""

import json
import sys
from pathlib import Path

COLUMNS = ["utfsm", "utfpr-0.00v", "utfpr-0.87v", "utfpr-1.98v", "utfpr-3.21v", "nees"]
FORMS = {"semi_active": "", "fuzzy": " (fuzzy)", "free_fuzzy": " (free sets)"}


def mean_esr(report, predictor):
    """Mean NMSE of each model over all held-out runs; models that failed on any run are left out."""
    rows = {}
    for row in report["cross_validation"]:
        if row["predictor"] == predictor:
            rows.setdefault((row["model"], row["form"]), []).append(row["esr"])
    return {model: sum(esr) / len(esr) for model, esr in rows.items() if None not in esr}


def main(out):
    reports = [json.loads((out / f"{name}.json").read_text()) for name in COLUMNS]
    free = [mean_esr(report, "free_run") for report in reports]
    steps = [mean_esr(report, "one_step") for report in reports]
    best = [min(column.values()) for column in free]
    models = sorted({model for column in free for model in column})

    def place(model):
        # Geometric mean of the ratio to the best NMSE, over the columns in which the model has a
        # value.
        ratios = [column[model] / least for column, least in zip(free, best) if model in column]
        missing = len(free) - len(ratios)
        product = 1.0
        for ratio in ratios:
            product *= ratio
        return missing, product ** (1 / max(len(ratios), 1))

    print("| mean NMSE, free run | " + " | ".join(COLUMNS) + " |")
    print("|---|" + "---|" * len(COLUMNS))
    for model in sorted(models, key=place):
        cells = [
            "-" if model not in column else (f"**{column[model]:.3f}**" if column[model] == least else f"{column[model]:.3f}")
            for column, least in zip(free, best)
        ]
        print(f"| `{model[0]}`{FORMS[model[1]]} | " + " | ".join(cells) + " |")
    arx = [column.get(("arx", "semi_active")) for column in steps]
    print("| ARX, one step ahead | " + " | ".join("-" if esr is None else f"{esr:.4f}" for esr in arx) + " |")
    tested = [{row["tested_on"] for row in report["cross_validation"]} for report in reports]
    persistence = []
    for report, names in zip(reports, tested):
        rows = [row["esr"] for row in report["persistence"] if row["experiment"] in names and row["esr"] is not None]
        persistence.append(f"{sum(rows) / len(rows):.4f}" if rows else "-")
    print("| persistence, one step ahead | " + " | ".join(persistence) + " |")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
