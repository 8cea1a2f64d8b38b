//! The runs that the arguments ask for.

use super::manifest::Entry;
use super::{Args, Format};
use crate::settings::error::NodeError;
use crate::settings::interrupt::Interrupt;
use mr_damper_base::provenance::TOOL;
use mr_damper_model::rig::{
    self, Channels, Current, Drift, Experiment, Pattern, Plant, SecondOrder, inject::inject,
};
use mr_damper_model::sample::Run;
use std::collections::BTreeMap;

/// The experiments that `--experiment` selects.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::commands) enum Selection {
    /// The eight of the thesis.
    Thesis,
    /// The ten of the first paper.
    Paper1,
    /// One experiment by its name, or `sine`, `chirp`, `road`.
    One(String),
}

/// Experiments that are defined by flags.
pub(super) const OWN: [&str; 3] = ["sine", "chirp", "road"];

/// An effect with its size.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct EffectArg {
    id: String,
    size: f64,
}

/// One run to simulate.
pub(in crate::commands) struct Job {
    pub(in crate::commands) experiment: Experiment,
    pub(super) plant: Plant,
    pub(super) channels: Channels,
    /// Its entry in the manifest, with its file name.
    pub(super) entry: Entry,
}

impl Job {
    /// Number of the replicate, from 1.
    pub(in crate::commands) const fn replicate(&self) -> u32 {
        self.entry.replicate
    }

    /// Simulates the run, and calls `progress` with the seconds done once per second of the run. `None` when interrupted.
    pub(in crate::commands) fn record(
        &self,
        interrupt: &Interrupt,
        progress: &mut dyn FnMut(f64),
    ) -> Option<Run> {
        let mut go_on = |done_s: f64| {
            progress(done_s);
            !interrupt.is_raised()
        };
        let run =
            rig::record_while(&self.experiment, &self.plant, &self.channels, self.entry.run_seed, &mut go_on);
        run.filter(|_| !interrupt.is_raised())
    }
}

/// All names that `--experiment` takes for one experiment.
fn names() -> impl Iterator<Item = &'static str> {
    Experiment::names().chain(Experiment::paper1_names()).chain(OWN)
}

/// Reasons why the value of `--experiment` or `--effect` is not valid. clap says which flag it was given for.
#[derive(Debug, thiserror::Error)]
pub(super) enum PlanError {
    #[error("{}`mr-damper simulate --list` lists all", nearest.map(|nearest| format!("the nearest is {nearest}; ")).unwrap_or_default())]
    UnknownExperiment { nearest: Option<&'static str> },
    #[error("give ID=SIZE, e.g. friction=60")]
    NoSize,
    #[error("\"{text}\" is not a number")]
    NotANumber { text: String },
    #[error(transparent)]
    Effect(#[from] mr_damper_model::Error),
}

/// Parses `--experiment`.
pub(super) fn selection(text: &str) -> Result<Selection, PlanError> {
    match text.to_ascii_lowercase().as_str() {
        "all" | "thesis" => return Ok(Selection::Thesis),
        "paper1" => return Ok(Selection::Paper1),
        _ => {}
    }
    if let Some(name) = names().find(|name| name.eq_ignore_ascii_case(text)) {
        return Ok(Selection::One(name.to_owned()));
    }
    let distance =
        |name: &&str| strsim::damerau_levenshtein(&name.to_ascii_lowercase(), &text.to_lowercase());
    // A name that differs in more than half of its characters is not a misspelling.
    let nearest = names().min_by_key(distance).filter(|name| 2 * distance(name) <= name.len());
    Err(PlanError::UnknownExperiment { nearest })
}

/// Parses `--effect ID=SIZE` and checks it on the default rig.
pub(super) fn effect(text: &str) -> Result<EffectArg, PlanError> {
    let (id, size) = text.split_once('=').ok_or(PlanError::NoSize)?;
    let size = size.parse().map_err(|_| PlanError::NotANumber { text: size.to_owned() })?;
    inject(id, size, &mut Plant::default(), &mut Channels::default())?;
    Ok(EffectArg { id: id.to_owned(), size })
}

/// All runs, in order.
pub(super) fn jobs(args: &Args, selection: &Selection) -> Result<Vec<Job>, NodeError> {
    let experiments: Vec<Experiment> = match selection {
        Selection::Thesis => Experiment::names().filter_map(Experiment::thesis).collect(),
        Selection::Paper1 => Experiment::paper1_names().filter_map(Experiment::paper1).collect(),
        Selection::One(name) => {
            let own = || own(args, name);
            Experiment::thesis(name).or_else(|| Experiment::paper1(name)).map_or_else(own, |e| vec![e])
        }
    };
    refuse_unused(args, selection, &experiments)?;
    let (mut plant, mut channels) = (
        if args.plain { Plant::plain() } else { Plant::default() },
        if args.perfect { Channels::PERFECT } else { Channels::default() }.with_ambient(),
    );
    channels.force_noise_n = args.force_noise.unwrap_or(channels.force_noise_n);
    channels.check()?;
    for effect in &args.effect {
        inject(&effect.id, effect.size, &mut plant, &mut channels)?;
    }
    let mut jobs = Vec::new();
    for experiment in experiments {
        let experiment = adjusted(experiment, args);
        experiment.check()?;
        for replicate in 1..=args.replicates.unwrap_or(experiment.replicates) {
            jobs.push(job(args, &experiment, replicate, plant, channels));
        }
    }
    Ok(jobs)
}

/// An experiment that is defined by flags.
fn own(args: &Args, name: &str) -> Vec<Experiment> {
    let current_a = args.current.unwrap_or(1.2);
    let frequency = |default| args.frequency.unwrap_or(default);
    let amplitude = |default| args.amplitude.unwrap_or(default);
    let experiment = match name {
        "sine" => Experiment::sine(amplitude(0.02), frequency(1.5), current_a, 10.0),
        "chirp" => {
            let to_hz = args.to_frequency.unwrap_or(14.5);
            Experiment::chirp(amplitude(0.0025), frequency(0.5), to_hz, current_a, 30.0)
        }
        _ => Experiment::road(current_a, 30.0),
    };
    // The file gets this name.
    vec![Experiment { name: name.to_owned(), ..experiment }]
}

/// Refuses flags that would do nothing for the selected experiments.
fn refuse_unused(args: &Args, selection: &Selection, experiments: &[Experiment]) -> Result<(), NodeError> {
    let is = |name: &str| *selection == Selection::One(name.to_owned());
    let constant = |e: &Experiment| matches!(e.current, Current::Constant { .. });
    for (flag, value, used, needs) in [
        ("--amplitude", args.amplitude, is("sine") || is("chirp"), "sine or chirp"),
        ("--frequency", args.frequency, is("sine") || is("chirp"), "sine or chirp"),
        ("--to-frequency", args.to_frequency, is("chirp"), "chirp"),
        ("--current", args.current, experiments.iter().all(constant), "one with a constant current"),
    ] {
        if let (Some(value), false) = (value, used) {
            return Err(NodeError::Parameter {
                name: flag.to_owned(),
                value: value.to_string(),
                expected: format!("left out, unless the experiment is {needs}"),
            });
        }
    }
    Ok(())
}

/// The experiment with the changes from flags and with the servo of the rig.
fn adjusted(experiment: Experiment, args: &Args) -> Experiment {
    let duration_s = args.duration.unwrap_or(experiment.duration_s);
    let experiment = match args.current {
        Some(current_a) => experiment.with_constant_current_a(current_a),
        None => experiment,
    };
    experiment.with_duration_s(duration_s).with_servo(SecondOrder::SERVO)
}

fn job(args: &Args, experiment: &Experiment, replicate: u32, plant: Plant, channels: Channels) -> Job {
    let pattern = if args.same_pattern { Pattern::Same } else { Pattern::New };
    let (experiment, run_seed) = experiment.replicate(replicate, args.seed, pattern);
    let drift = match (args.steady, args.perfect) {
        (true, _) => Drift::NONE,
        (false, true) => Drift { offset_n: 0.0, ..Drift::default() },
        (false, false) => Drift::default(),
    };
    let (plant, channels) = drift.apply(plant, channels, run_seed);
    let stem = format!("{}-{replicate:02}", experiment.name.to_ascii_lowercase());
    let file = match args.format {
        Format::Csv => format!("{stem}.csv"),
        Format::Mcap => stem,
    };
    let effects: BTreeMap<String, f64> = args.effect.iter().map(|e| (e.id.clone(), e.size)).collect();
    let entry = Entry {
        file,
        experiment: experiment.name.clone(),
        replicate,
        seed: args.seed,
        run_seed,
        pattern_seed: experiment.pattern.unwrap_or(run_seed),
        duration_s: experiment.duration_s,
        amplitude_m: args.amplitude,
        frequency_hz: args.frequency,
        to_frequency_hz: args.to_frequency,
        current_a: match experiment.current {
            Current::Constant { current_a } => Some(current_a),
            _ => None,
        },
        plain: args.plain,
        steady: args.steady,
        perfect: args.perfect,
        force_noise_n: channels.force_noise_n,
        start_temp_c: plant.start_c,
        tool: TOOL.to_owned(),
        effects,
    };
    Job { experiment, plant, channels, entry }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        args: Args,
    }

    fn planned(flags: &[&str]) -> Result<Vec<Job>, String> {
        let line = ["simulate", "--out", "x"].iter().chain(flags);
        let args = Line::try_parse_from(line).map_err(|e| e.to_string())?.args;
        let selection = args.experiment.clone().ok_or("no experiment")?;
        jobs(&args, &selection).map_err(|e| e.to_string())
    }

    #[test]
    fn all_gives_the_43_runs_of_the_thesis_with_different_patterns() {
        let jobs = planned(&["--experiment", "all"]).expect("a plan");
        assert_eq!(jobs.len(), 43);
        assert_eq!(
            (jobs[0].entry.file.as_str(), jobs[42].entry.file.as_str()),
            ("rp-icps-01.csv", "rp3-cs-01.csv")
        );
        let distinct =
            |of: fn(&Job) -> u64| jobs.iter().map(of).collect::<std::collections::HashSet<_>>().len();
        assert_eq!((distinct(|job| job.entry.pattern_seed), distinct(|job| job.entry.run_seed)), (43, 43));
        let same = planned(&["--experiment", "rp-icps", "--same-pattern"]).expect("a plan");
        assert!(same.iter().all(|job| job.entry.pattern_seed == jobs[0].entry.pattern_seed));
        assert_eq!(same[1].entry.run_seed, jobs[1].entry.run_seed);
    }

    #[test]
    fn flags_reach_experiment_plant_and_channels() {
        let flags =
            ["--experiment=chirp", "--to-frequency=9", "--current=0.4", "--effect=friction=60", "--plain"];
        let jobs = planned(&flags).expect("a plan");
        assert_eq!(jobs[0].plant.friction_n, 60.0);
        assert_eq!(jobs[0].plant.coil_rise_s, 0.0);
        assert_eq!(
            planned(&["--experiment=road", "--force-noise=40"]).expect("a plan")[0].channels.force_noise_n,
            40.0
        );
        assert_eq!(jobs[0].experiment.current, Current::Constant { current_a: 0.4 });
        assert!(format!("{:?}", jobs[0].experiment.displacement).contains("to_hz: 9.0"));
        let steady =
            planned(&["--experiment=road", "--steady", "--perfect", "--replicates=2"]).expect("a plan");
        assert_eq!(steady[1].plant, Plant::default());
        assert_eq!(steady[1].channels, Channels::PERFECT.with_ambient());
    }

    #[test]
    fn unused_flags_and_impossible_values_are_refused() {
        for (flags, word) in [
            (&["--experiment=RP-IPCS"][..], "the nearest is RP-ICPS"),
            (&["--experiment=RP-ICPS", "--current=1"], "constant current"),
            (&["--experiment=all", "--frequency=1"], "sine or chirp"),
            (&["--experiment=sine", "--duration=-1"], "positive number of seconds"),
            (&["--experiment=sine", "--frequency=0"], "above 0"),
            (&["--experiment=sine", "--force-noise=-1"], "force_noise_n"),
            (&["--experiment=sine", "--effect=stiction=1"], "coil_lag"),
            (&["--experiment=sine", "--effect=friction"], "ID=SIZE"),
            (&["--experiment=sine", "--effect=friction=-5"], "0 to 1000"),
        ] {
            let refused = planned(flags).err().expect("refused");
            assert!(refused.contains(word), "{flags:?}: {refused}");
        }
    }
}
