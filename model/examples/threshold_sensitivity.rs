//! Measures what the diagnosis answers with each of its thresholds at half and at double the default.
//!
//! ```text
//! cargo run --release -p mr-damper-model --example threshold_sensitivity -- [--seeds 1] [--first 0] [--part effects] [--only NAME]
//!     --seeds N     seeds of each case
//!     --first N     the first seed
//!     --part PART   effects, verdict, structures, pairs or terms; all without it
//!     --only NAME   the threshold with this name
//! ```
//!
//! Prints the rows of the guide's table. Each cell of half and double has three counts. The first is of the cases with an effect in which each
//! effect was named, the second of cases in which one was named that is not there. The third is of the cases whose names, terms or verdict
//! differ from the answers of all defaults. For terms, the first two count the cases in which a term or a hum was claimed as an effect, with
//! an effect in the runs and without one.
//!
//! | part | cases |
//! |---|---|
//! | effects, verdict | each of the 16 effects at half or full size on a quasi-static valve, 2 pairs, 2 without effect; base fuzzy-tanh |
//! | structures | Bouc-Wen, bristle and shear-thinning valve, each with and without an effect; the base is chosen |
//! | pairs | 5 effects and none on a Bouc-Wen valve, with healthy runs of the same motion |
//! | terms | 4 effects outside the library and 2 cases without effect, with a healthy run; base fuzzy-tanh |

#[path = "../tests/all/diagnosis/mod.rs"]
mod diagnosis;

use diagnosis::cases::{CaseSpec, Kind, OUTSIDE, spec};
use diagnosis::outcome::{Instrumentation, Outcome, Prepared, outcome};
use diagnosis::rates::{Rate, is_right, wrong_names};
use mr_damper_model::Error;
use mr_damper_model::diagnose::{DiagnosisResult, Part, Settings, Threshold, Thresholds};
use std::io::Write as _;

const PARTS: [(&str, Part); 5] = [
    ("effects", Part::Effects),
    ("verdict", Part::Verdict),
    ("structures", Part::Structures),
    ("pairs", Part::Pairs),
    ("terms", Part::Terms),
];

struct Arguments {
    seeds: u64,
    first: u64,
    part: Option<Part>,
    only: Option<String>,
}

fn arguments() -> Result<Arguments, Box<dyn std::error::Error>> {
    let mut given = Arguments { seeds: 1, first: 0, part: None, only: None };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value = words.next().ok_or_else(|| format!("{word} needs a value"))?;
        match word.as_str() {
            "--seeds" => given.seeds = value.parse()?,
            "--first" => given.first = value.parse()?,
            "--part" => {
                let known = PARTS.iter().find(|(name, _)| *name == value);
                given.part = Some(known.ok_or_else(|| format!("--part {value} is unknown"))?.1);
            }
            "--only" => given.only = Some(value),
            _ => return Err(format!("{word} is unknown; see the top of the example").into()),
        }
    }
    Ok(given)
}

/// Names of the cases in which the thresholds of `part` matter.
fn names(part: Part) -> Vec<String> {
    let of = |kind: Kind, ids: &[&str]| -> Vec<String> {
        let kind = kind.name();
        ids.iter().map(|id| format!("{kind} {id} x1")).collect()
    };
    match part {
        Part::Effects | Part::Verdict => {
            let sizes = diagnosis::cases::sizes();
            let single = |(k, (id, _)): (usize, &(&str, f64))| {
                format!("single {id} {}", if k % 2 == 0 { "x1" } else { "x0.5" })
            };
            let singles = sizes.iter().enumerate().map(single);
            let others = ["pair coil_lag + gas_spring x1", "pair thermal_fade + coil_lag x1", "null", "null"];
            singles.chain(others.map(str::to_owned)).collect()
        }
        Part::Structures => {
            use diagnosis::cases::Valve::{BoucWen, Bristle, Thinning};
            let valves = [(BoucWen, "coil_lag"), (Bristle, "friction"), (Thinning, "gas_spring")];
            let of_valve = |(valve, id)| {
                let kind = Kind::WrongBase(valve);
                [format!("{} null", kind.name()), of(kind, &[id]).concat()]
            };
            valves.into_iter().flat_map(of_valve).collect()
        }
        Part::Pairs => {
            let ids = ["coil_lag", "thermal_fade", "gas_spring", "friction", "deadzone"];
            let mut all = of(Kind::Paired, &ids);
            all.push(format!("{} null", Kind::Paired.name()));
            all
        }
        Part::Terms => {
            let mut all = of(Kind::Outside, &OUTSIDE.map(|(id, _)| id));
            all.extend(["null".to_owned(), "null".to_owned()]);
            all
        }
    }
}

/// The result of a diagnosis of a case.
struct Answer {
    outcome: Outcome,
    /// The discovered terms and hum that are effects, as text without numbers.
    effects: Vec<String>,
    /// The terms that may belong to the structure.
    others: Vec<String>,
}

impl Answer {
    fn new(found: &DiagnosisResult, name: &str) -> Self {
        let kind = |term: &&mr_damper_model::diagnose::discover::FoundTerm| format!("{:?}", term.term.kind());
        let (effects, others): (Vec<_>, Vec<_>) =
            found.discovery.terms.iter().partition(|term| term.claim.is_effect());
        let mut effects: Vec<String> = effects.iter().map(kind).collect();
        effects.extend(found.discovery.hum.iter().map(|_| "hum".to_owned()));
        Self { outcome: outcome(found, name), effects, others: others.iter().map(kind).collect() }
    }

    fn is_like(&self, other: &Self) -> bool {
        let names = |outcome: &Outcome| -> Vec<Vec<String>> {
            outcome.named.iter().map(|named| named.ids.clone()).collect()
        };
        names(&self.outcome) == names(&other.outcome)
            && self.outcome.verdict == other.outcome.verdict
            && self.effects == other.effects
            && self.others == other.others
    }
}

/// The cases of a part, ready for diagnoses, with the answers of the defaults.
struct Cases {
    part: Part,
    all: Vec<(CaseSpec, Prepared)>,
    defaults: Vec<Answer>,
}

impl Cases {
    fn new(part: Part, given: &Arguments) -> Result<Self, Error> {
        let instrumentation = match part {
            Part::Structures => Instrumentation::Auto,
            _ => Instrumentation::Displacement,
        };
        let mut all = Vec::new();
        for (k, name) in (0_u64..).zip(names(part)) {
            let spec = spec(&name);
            for seed in given.first..given.first + given.seeds {
                // Cases of one name differ by their seed.
                let seed = seed + 1000 * k;
                let healthy = match part {
                    Part::Terms => spec.healthy_runs(seed)?,
                    _ => Vec::new(),
                };
                let prepared = Prepared::new(&spec.case(seed)?, &healthy, instrumentation)?;
                all.push((spec.clone(), prepared));
            }
        }
        let mut cases = Self { part, all, defaults: Vec::new() };
        cases.defaults = cases.answers(&Thresholds::default())?;
        Ok(cases)
    }

    fn answers(&self, thresholds: &Thresholds) -> Result<Vec<Answer>, Error> {
        let defaults = Settings::default();
        let most_terms = if self.part == Part::Terms { defaults.most_terms } else { 0 };
        let settings = Settings { most_terms, thresholds: *thresholds, ..defaults };
        let answer =
            |(spec, case): &(CaseSpec, Prepared)| Ok(Answer::new(&case.diagnose(&settings)?, &spec.name()));
        self.all.iter().map(answer).collect()
    }

    /// Rates of right and wrong answers.
    fn rates(&self, answers: &[Answer]) -> [Rate; 2] {
        let (mut right, mut wrong) = (Rate::default(), Rate::default());
        for ((spec, _), answer) in self.all.iter().zip(answers) {
            let (is_found, is_false) = match self.part {
                Part::Terms => {
                    (!answer.effects.is_empty(), spec.truth.is_empty() && !answer.effects.is_empty())
                }
                _ => (is_right(spec, &answer.outcome), !wrong_names(spec, &answer.outcome).is_empty()),
            };
            if !spec.truth.is_empty() {
                right.count(is_found);
            }
            wrong.count(is_false);
        }
        [right, wrong]
    }

    fn text(&self, answers: &[Answer]) -> String {
        let changed =
            self.defaults.iter().zip(answers).filter(|(default, own)| !default.is_like(own)).count();
        let [right, wrong] = self.rates(answers);
        format!("{}/{}, {}/{}, {changed}", right.hits, right.of, wrong.hits, wrong.of)
    }

    fn row(&self, threshold: &Threshold) -> Result<String, Error> {
        let changed = |factor| {
            let mut thresholds = Thresholds::default();
            let value = threshold.scaled(factor);
            threshold.set(&mut thresholds, value);
            Ok::<_, Error>(format!("{value}: {}", self.text(&self.answers(&thresholds)?)))
        };
        let Threshold { name, default, source, .. } = threshold;
        let meaning = threshold.meaning();
        Ok(format!("| `{name}` | {default} | {source} | {meaning} | {} | {} |", changed(0.5)?, changed(2.0)?))
    }
}

/// Prints a line at once: a part takes minutes.
fn print(line: &str) {
    println!("{line}");
    let _ = std::io::stdout().flush();
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let given = arguments()?;
    print("| threshold | default | source | what it decides | half | double |");
    print("|---|---:|---|---|---|---|");
    for (name, part) in PARTS.into_iter().filter(|(_, part)| given.part.is_none_or(|only| only == *part)) {
        let own =
            |row: &&Threshold| row.part == part && given.only.as_deref().is_none_or(|only| only == row.name);
        let rows: Vec<&Threshold> = Thresholds::TABLE.iter().filter(own).collect();
        if rows.is_empty() {
            continue;
        }
        let cases = Cases::new(part, &given)?;
        print(&format!("*{name}*, all defaults: {}", cases.text(&cases.defaults)));
        for row in rows {
            print(&cases.row(row)?);
        }
    }
    Ok(())
}
