//! Measures how often one designed run names the true effect alone, where a diagnosis could not, with a road profile of the same length
//! beside it.
//!
//! ```text
//! cargo run --release -p mr-damper-model --example design_rates -- [--seeds 6] [--first 0] [--only ID] [--seconds 30] [--size 1] [--acceleration 25] [--pair "ID|ID"]
//!     --only ID      cases with this effect
//!     --pair "A|B"   asks for this pair whatever the report says; the truth is one of both
//!     --seconds S    length of the designed run and of the road
//!     --size X       size of the effect, as a multiple of the catalogue's
//!     --acceleration A   limit of the designed run and of the road, m/s²
//!     --unfiltered   without a filter of the force: the default filter is 20 Hz
//!     --earlier KIND the earlier runs: "road", the catalogue's; "sine", one sine of 2 Hz; "mild", slow and at most 20 mm (default)
//!     --plans        print the designs, and diagnose nothing
//! ```
//!
//! A case has a damper with one effect. The base is identified on an earlier run of that damper, and a diagnosis of two earlier runs follows,
//! with the whole library. If it names a class with more than one effect, that class is the question. If it names nothing, the effects that
//! it could neither show nor exclude are no question here: only confounded effects count. The design gets the model file of that diagnosis,
//! its noise floor and the question. The rig plays the designed run once. The next diagnosis has the first two thirds of it as training run
//! beside the earlier one, and the last third as validation run. "Road" is the same with a road within the same limits.
//!
//! A case is right if the diagnosis names exactly one effect, the true one, and its class has no other member. It is separated if the effect
//! is named and no rival of the question is in its class. "Wrong" counts cases in which an effect is named whose class does not hold the true
//! one. A design that refuses, because it expects that no run separates the rivals, is counted by itself.

#[path = "../tests/all/diagnosis/mod.rs"]
mod diagnosis;

use diagnosis::cases::{CaseSpec, Kind, full_size, spec};
use diagnosis::outcome::CONDITIONING;
use diagnosis::rates::Rate;
use mr_damper_model::Error;
use mr_damper_model::condition::{ApplyTo, Conditioning};
use mr_damper_model::diagnose::design::{Design, Limits, Question, Settings as DesignSettings, design};
use mr_damper_model::diagnose::{Runs, Settings, close};
use mr_damper_model::effect::Effect;
use mr_damper_model::identify::{
    Dataset, DatasetOptions, ModelSpec, Options, Placement, Watch, identify_datasets,
};
use mr_damper_model::model::Model;
use mr_damper_model::rig::{Current, Displacement, Experiment, Motion, Road, play_while, record};
use mr_damper_model::sample::{Run, Stamp};
use rayon::prelude::*;

/// The test bench of the rig: the stroke and speed of the catalogue's roads.
const LIMITS: Limits = Limits {
    stroke_m: 0.018,
    speed_m_s: 0.5,
    acceleration_m_s2: 25.0,
    drive: Some([0.0, 2.5]),
    duration_s: 30.0,
    rate_hz: 512.0,
};

/// The runs before the designed one.
#[derive(Clone, Copy)]
enum Earlier {
    Road,
    Mild,
    Sine,
}

impl Earlier {
    fn parse(text: &str) -> Result<Self, String> {
        match text {
            "road" => Ok(Self::Road),
            "mild" => Ok(Self::Mild),
            "sine" => Ok(Self::Sine),
            _ => Err(format!("--earlier {text} is unknown: give road, mild or sine")),
        }
    }
}

struct Arguments {
    seeds: u64,
    first: u64,
    only: String,
    pair: Option<String>,
    seconds: f64,
    size: f64,
    acceleration_m_s2: f64,
    unfiltered: bool,
    earlier: Earlier,
    plans: bool,
}

fn arguments() -> Result<Arguments, Box<dyn std::error::Error>> {
    let mut given = Arguments {
        seeds: 6,
        first: 0,
        only: String::new(),
        pair: None,
        seconds: 30.0,
        size: 1.0,
        acceleration_m_s2: LIMITS.acceleration_m_s2,
        unfiltered: false,
        earlier: Earlier::Mild,
        plans: false,
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or_else(|| format!("{word} needs a value"));
        match word.as_str() {
            "--seeds" => given.seeds = value()?.parse()?,
            "--first" => given.first = value()?.parse()?,
            "--only" => given.only = value()?,
            "--pair" => given.pair = Some(value()?),
            "--seconds" => given.seconds = value()?.parse()?,
            "--size" => given.size = value()?.parse()?,
            "--acceleration" => given.acceleration_m_s2 = value()?.parse()?,
            "--unfiltered" => given.unfiltered = true,
            "--earlier" => given.earlier = Earlier::parse(&value()?)?,
            "--plans" => given.plans = true,
            _ => return Err(format!("{word} is unknown; see the top of the example").into()),
        }
    }
    Ok(given)
}

/// A dataset for the diagnosis.
fn rows(run: &Run, conditioning: &Conditioning) -> Result<Dataset, Error> {
    Dataset::from_run(run, conditioning, &DatasetOptions::default())
}

fn part(run: &Run, from_s: f64, to_s: f64, name: &str) -> Run {
    let stamp = |s: f64| Stamp::from_nanos((s * 1e9) as i64);
    Run { name: name.to_owned(), ..run.between(stamp(from_s), stamp(to_s)) }
}

/// The recording of a motion and a current on the damper of the case.
fn played(spec: &CaseSpec, run: &Run, which: usize, seed: u64) -> Result<Run, Error> {
    let (plant, channels) = spec.damper(which)?;
    let current_a = run.drive.as_ref().map(|(_, trace)| trace.values.clone()).unwrap_or_default();
    let motion = Motion::recorded(run.displacement_m.values.clone());
    Ok(play_while(&motion, &current_a, &plant, &channels, seed, &mut |_| true).unwrap_or_default())
}

/// An earlier run with random currents, on `displacement`.
fn earlier(spec: &CaseSpec, which: usize, seed: u64, displacement: Displacement) -> Result<Run, Error> {
    let current =
        Current::Aprbs { low_a: 0.0, high_a: 2.5, mean_a: 1.2, deviation_a: 1.0, hold_probability: 0.99 };
    let experiment = Experiment::new("earlier", displacement, current, 30.0);
    let (plant, channels) = spec.damper(which)?;
    let run = record(&experiment, &plant, &channels, seed * 10 + which as u64 + 77);
    Ok(Run { name: format!("earlier {which}"), ..run })
}

/// What a diagnosis says.
#[derive(Default, Clone)]
struct Said {
    model: Option<(Model, Option<f64>)>,
    right: bool,
    separated: bool,
    wrong: bool,
    classes: Vec<Vec<&'static str>>,
    text: String,
}

/// The diagnosis of training and validation runs of a damper with the effect `truth`.
fn diagnose(
    base: &Model,
    estimate: &[Dataset],
    confirm: &[Dataset],
    truth: &str,
    rivals: &[&str],
) -> Result<Said, Error> {
    let runs = Runs { estimate, confirm, ..Runs::default() };
    let settings = Settings { most_terms: 0, ..Settings::default() };
    let found = close(base, &runs, &settings, &Watch::none(), &|_| {})?;
    let classes: Vec<Vec<&'static str>> = found.effects.iter().map(|named| named.class.clone()).collect();
    let own = found.effects.iter().find(|named| named.class.contains(&truth));
    let refused = found.refused.iter().chain(&found.untestable);
    let why: Vec<String> = refused
        .filter(|refused| refused.effect.id() == truth)
        .map(|refused| refused.why.to_string())
        .collect();
    let floor_n = found.noise_floor.is_known().then_some(found.noise_floor.rsse_n);
    Ok(Said {
        model: Some((found.after, floor_n)),
        right: classes.len() == 1 && classes[0] == [truth],
        separated: own.is_some_and(|named| named.class.iter().all(|id| *id == truth || !rivals.contains(id))),
        wrong: classes.iter().any(|class| !class.contains(&truth)),
        text: format!("{} {classes:?} {}", found.verdict.name(), why.join("; ")),
        classes,
    })
}

/// Outcome of a case.
enum Outcome {
    /// The report left no question.
    Decided,
    /// The class does not hold the true effect.
    Elsewhere,
    Refused(String),
    Both(Box<[Said; 2]>, String),
}

fn case(given: &Arguments, spec: &CaseSpec, truth: &'static str, seed: u64) -> Result<Outcome, Error> {
    let conditioning = Conditioning {
        apply_to: if given.unfiltered { ApplyTo::None } else { ApplyTo::Output },
        ..CONDITIONING
    };
    let limits = Limits { duration_s: given.seconds, acceleration_m_s2: given.acceleration_m_s2, ..LIMITS };
    let slow = Road { level_hz: 0.5, band_hz: 1.5, span_m: Some(0.02), ..Road::SMOOTH_HIGHWAY };
    let both = |displacement: Displacement| -> Result<[Run; 2], Error> {
        Ok([earlier(spec, 0, seed, displacement)?, earlier(spec, 1, seed, displacement)?])
    };
    let runs = match given.earlier {
        Earlier::Road => {
            let case = spec.case(seed)?;
            [case.estimate[0].clone(), case.confirm[0].clone()]
        }
        Earlier::Mild => both(Displacement::Road(slow))?,
        Earlier::Sine => both(Displacement::Sine { amplitude_m: 0.01, frequency_hz: 2.0 })?,
    };
    let earlier = [rows(&runs[0], &conditioning)?, rows(&runs[1], &conditioning)?];
    let options = Options {
        conditioning,
        choose_velocity: false,
        restarts: 5,
        placement: Placement::Given {
            centres: (0..7).map(|k| 2.5 / 6.0 * f64::from(k)).collect(),
            sigma: Some(0.7 * 2.5 / 6.0),
        },
        ..Options::default()
    };
    let base = identify_datasets(ModelSpec::FUZZY_TANH, &earlier[..1], &options, &Watch::none())?.model;
    // The design gets the model file and the noise floor of the report, as a user does.
    let report = diagnose(&base, &earlier[..1], &earlier[1..], truth, &[])?;
    let (known, noise_n) = report.model.unwrap_or((base, None));
    let question: Vec<&'static str> = match &given.pair {
        Some(pair) => Question::parse(pair)?.groups()[0].clone(),
        None => match report.classes.iter().find(|class| class.len() > 1) {
            None => return Ok(Outcome::Decided),
            Some(class) if !class.contains(&truth) => return Ok(Outcome::Elsewhere),
            Some(class) => class.clone(),
        },
    };
    let settings = DesignSettings { noise_n, seed, ..DesignSettings::default() };
    let asked = Question::new(std::slice::from_ref(&question))?;
    let start = std::time::Instant::now();
    let planned = match design(&known, &asked, &limits, &settings, &Watch::none()) {
        Ok(planned) => planned,
        Err(error) => return Ok(Outcome::Refused(format!("{asked}: {error}"))),
    };
    if given.plans {
        print_plan(&planned, start.elapsed().as_secs_f64());
    }
    let split_s = planned.split_s.unwrap_or(given.seconds * 2.0 / 3.0);
    let mut said = [Said::default(), Said::default()];
    if !given.plans {
        for (said, run) in said.iter_mut().zip([&planned.run, &planned.road]) {
            let new = played(spec, run, 0, seed + 1000)?;
            let parts = [(0.0, split_s, "training part"), (split_s, given.seconds + 1.0, "validation part")];
            let parts =
                parts.map(|(from_s, to_s, name)| rows(&part(&new, from_s, to_s, name), &conditioning));
            let [training, validation] = parts;
            let estimate = [earlier[0].clone(), training?];
            *said = diagnose(&base, &estimate, &[validation?], truth, &question)?;
        }
    }
    let expected = planned.pairs.iter().all(|pair| pair.designed.is_enough());
    let text = format!("{asked}, all pairs expected: {expected}");
    Ok(Outcome::Both(Box::new(said), text))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let given = arguments()?;
    println!(
        "{:<22} {:>9} {:>22} {:>10} {:>6} {:>22} {:>10} {:>6} {:>8} {:>10}",
        "truth",
        "confounded",
        "designed: right",
        "separated",
        "wrong",
        "road: right",
        "separated",
        "wrong",
        "refused",
        "elsewhere"
    );
    let truths: Vec<&'static str> = match &given.pair {
        Some(pair) => Question::parse(pair)?.groups()[0].clone(),
        None => Effect::ids(),
    };
    let mut totals = [[Rate::default(); 3]; 2];
    for truth in truths.into_iter().filter(|id| id.contains(&given.only)) {
        let null = spec("null");
        let truths = vec![(truth, given.size * full_size(truth))];
        let spec = CaseSpec { kind: Kind::Single, truth: truths, ..null };
        let seeds: Vec<u64> = (given.first..given.first + given.seeds).collect();
        let found = seeds
            .par_iter()
            .map(|seed| case(&given, &spec, truth, *seed))
            .collect::<Vec<Result<Outcome, Error>>>();
        let mut rates = [[Rate::default(); 3]; 2];
        let (mut refused, mut elsewhere) = (0, 0);
        for (seed, outcome) in seeds.iter().zip(found) {
            match outcome.unwrap_or_else(|error| Outcome::Refused(error.to_string())) {
                Outcome::Decided => {}
                Outcome::Elsewhere => elsewhere += 1,
                Outcome::Refused(why) => {
                    refused += 1;
                    println!("    seed {seed}: refused: {why}");
                }
                Outcome::Both(said, question) => {
                    for (rates, said) in rates.iter_mut().zip(said.iter()) {
                        for (rate, hit) in rates.iter_mut().zip([said.right, said.separated, said.wrong]) {
                            rate.count(hit);
                        }
                    }
                    if !said[0].right {
                        println!("    seed {seed}: {question}: {}", said[0].text);
                    }
                }
            }
        }
        for (totals, rates) in totals.iter_mut().zip(&rates) {
            totals.iter_mut().zip(rates).for_each(|(total, rate)| total.merge(*rate));
        }
        println!("{}", line(truth, &rates, refused, elsewhere));
    }
    println!("{}", line("all", &totals, 0, 0));
    Ok(())
}

fn line(truth: &str, [designed, road]: &[[Rate; 3]; 2], refused: u32, elsewhere: u32) -> String {
    format!(
        "{truth:<22} {:>9} {:>22} {:>10} {:>6} {:>22} {:>10} {:>6} {refused:>8} {elsewhere:>10}",
        designed[0].of,
        designed[0].text(),
        designed[1].hits,
        designed[2].hits,
        road[0].text(),
        road[1].hits,
        road[2].hits
    )
}

fn print_plan(planned: &Design, seconds: f64) {
    for pair in &planned.pairs {
        println!(
            "  {} {:?} or {:?}: d {:.2} N, alone {:.2} N, share {:.3}, z {:.2}, {:.1} s (road: d {:.2} N, share {:.3}, z {:.2})",
            pair.truth.effect().title(),
            pair.truth.parameters(),
            pair.rival,
            pair.designed.distance_n,
            pair.designed.alone_n,
            pair.designed.share,
            pair.designed.discrimination,
            pair.designed.needed_s,
            pair.road.distance_n,
            pair.road.share,
            pair.road.discrimination
        );
    }
    for segment in &planned.segments {
        println!("    {:.2} s {:.2} s {}", segment.start_s, segment.duration_s, segment.what);
    }
    println!("    noise {:.2} N, moving {:.1} s; took {seconds:.2} s", planned.noise_n, planned.moving_s);
}
