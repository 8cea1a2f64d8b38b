//! A designed run: what it decides, as JSON (`mr-damper/design/1`) and as text.

use mr_damper_base::provenance::TOOL;
use mr_damper_model::diagnose::design::{Design, Limits, NoiseSource, Pair, Question, Separation};
use mr_damper_model::model::{Envelope, Model};
use mr_damper_model::sample::DriveKind;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Everything the report shows.
#[derive(Debug, Clone)]
pub struct DesignOutcome {
    /// Name of the model.
    pub model: String,
    /// Kind of the model's drive.
    pub drive: Option<DriveKind>,
    /// The question that the run decides.
    pub question: Question,
    /// The limits that it keeps.
    pub limits: Limits,
    /// The design.
    pub design: Design,
    /// Name of the written run.
    pub run: String,
    /// Seed of the candidates.
    pub seed: u64,
    /// Further remarks, one sentence each.
    pub notes: Vec<String>,
}

/// Sentences about limits that are beyond the range of the runs that `model` was identified on.
#[must_use]
pub fn beyond(model: &Model, limits: &Limits) -> Vec<String> {
    let leaves = |range, values: [f64; 2]| values.into_iter().any(|value| Envelope::leaves(range, value));
    let envelope = &model.envelope;
    let mut channels = Vec::new();
    if leaves(envelope.displacement_m, [-limits.stroke_m, limits.stroke_m]) {
        channels.push("displacement");
    }
    if leaves(envelope.velocity_m_s, [-limits.speed_m_s, limits.speed_m_s]) {
        channels.push("speed");
    }
    if limits.drive.is_some_and(|drive| leaves(envelope.drive, drive)) {
        channels.push("drive");
    }
    if channels.is_empty() {
        return Vec::new();
    }
    vec![format!(
        "The limits of {} are beyond the range of the model's training runs, so its prediction there is uncertain.",
        channels.join(" and ")
    )]
}

/// The JSON. Numbers that are not finite become `null`.
#[derive(Debug, Serialize)]
pub struct DesignReport<'a> {
    schema: &'static str,
    tool: &'static str,
    model: &'a str,
    seed: u64,
    run: &'a str,
    groups: &'a [Vec<&'static str>],
    limits: LimitsRow,
    reached: ReachedRow,
    noise: NoiseRow,
    moving_s: f64,
    /// End of the training part, s; `null` if the run is too short for parts.
    split_s: Option<f64>,
    /// Assumed rise of the case temperature, K; `null` if no effect needs a temperature.
    assumed_rise_k: Option<f64>,
    pairs: Vec<PairRow>,
    segments: Vec<SegmentRow<'a>>,
    notes: &'a [String],
}

#[derive(Debug, Serialize)]
struct LimitsRow {
    stroke_m: f64,
    speed_m_s: f64,
    acceleration_m_s2: f64,
    drive: Option<[f64; 2]>,
    duration_s: f64,
    rate_hz: f64,
}

#[derive(Debug, Serialize)]
struct ReachedRow {
    stroke_m: f64,
    speed_m_s: f64,
    acceleration_m_s2: f64,
    drive: Option<[f64; 2]>,
}

#[derive(Debug, Serialize)]
struct NoiseRow {
    rms_n: f64,
    source: &'static str,
}

#[derive(Debug, Serialize)]
struct PairRow {
    /// Id of the effect that is taken as present.
    id: &'static str,
    form: Option<&'static str>,
    /// Id of the rival; `null` for the model without the effect.
    rival: Option<&'static str>,
    parameters: BTreeMap<&'static str, f64>,
    size_is_known: bool,
    separated: bool,
    checked: bool,
    designed: SeparationRow,
    road: SeparationRow,
}

#[derive(Debug, Serialize)]
struct SeparationRow {
    distance_n: f64,
    alone_n: f64,
    share: f64,
    discrimination: f64,
    probability: f64,
    /// Seconds for a probability of 95 %; `null` if no time is enough.
    needed_s: Option<f64>,
}

#[derive(Debug, Serialize)]
struct SegmentRow<'a> {
    start_s: f64,
    duration_s: f64,
    what: &'a str,
}

impl From<&Separation> for SeparationRow {
    fn from(found: &Separation) -> Self {
        Self {
            distance_n: found.distance_n,
            alone_n: found.alone_n,
            share: found.share,
            discrimination: found.discrimination,
            probability: found.probability,
            needed_s: Some(found.needed_s).filter(|s| s.is_finite()),
        }
    }
}

/// The parameters of the effect of `pair`, by their names for `drive`.
fn parameters(pair: &Pair, drive: Option<DriveKind>) -> impl Iterator<Item = (String, f64, String)> {
    let known = pair.truth.effect().parameters().iter().zip(pair.truth.parameters());
    known.map(move |(parameter, value)| {
        let unit = parameter.unit.symbol().or_else(|| drive.map(DriveKind::unit)).unwrap_or_default();
        (parameter.label(), *value, unit.to_owned())
    })
}

/// The JSON report of `outcome`.
#[must_use]
pub fn json(outcome: &DesignOutcome) -> DesignReport<'_> {
    let DesignOutcome { design, limits, .. } = outcome;
    let pair = |pair: &Pair| PairRow {
        id: pair.truth.effect().id(),
        form: pair.truth.effect().form(),
        rival: pair.rival,
        parameters: pair
            .truth
            .effect()
            .parameters()
            .iter()
            .map(|parameter| parameter.name)
            .zip(pair.truth.parameters().iter().copied())
            .collect(),
        size_is_known: pair.size_is_known,
        separated: pair.designed.is_enough(),
        checked: pair.is_checked,
        designed: (&pair.designed).into(),
        road: (&pair.road).into(),
    };
    DesignReport {
        schema: "mr-damper/design/1",
        tool: TOOL,
        model: &outcome.model,
        seed: outcome.seed,
        run: &outcome.run,
        groups: outcome.question.groups(),
        limits: LimitsRow {
            stroke_m: limits.stroke_m,
            speed_m_s: limits.speed_m_s,
            acceleration_m_s2: limits.acceleration_m_s2,
            drive: limits.drive,
            duration_s: limits.duration_s,
            rate_hz: limits.rate_hz,
        },
        reached: ReachedRow {
            stroke_m: design.reached.stroke_m,
            speed_m_s: design.reached.speed_m_s,
            acceleration_m_s2: design.reached.acceleration_m_s2,
            drive: design.reached.drive,
        },
        noise: NoiseRow { rms_n: design.noise_n, source: design.noise_source.name() },
        moving_s: design.moving_s,
        split_s: design.split_s,
        assumed_rise_k: design.assumed_rise_k,
        pairs: design.pairs.iter().map(pair).collect(),
        segments: design
            .segments
            .iter()
            .map(|s| SegmentRow { start_s: s.start_s, duration_s: s.duration_s, what: &s.what })
            .collect(),
        notes: &outcome.notes,
    }
}

/// `outcome` as text for a terminal.
#[must_use]
pub fn text(outcome: &DesignOutcome) -> String {
    let DesignOutcome { design, limits, .. } = outcome;
    let mut text = format!(
        "{}: {} s at {} Hz, to decide {} for {}\n\n{:<34}{:>18}{:>10}{:>12}{:>14}{:>22}\n",
        outcome.run,
        limits.duration_s,
        limits.rate_hz,
        outcome.question,
        outcome.model,
        "effect, rival",
        "forces differ by",
        "share",
        "expected",
        "95 % sure in",
        "on a road: 95 % in"
    );
    for pair in &design.pairs {
        let rival = pair.rival.unwrap_or("the model without it");
        let names = format!("{}, {rival}", pair.truth.effect().title());
        let mark = if pair.designed.is_enough() { "" } else { "   not separated" };
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "{names:<34}{:>16.2} N{:>8.0} %{:>12.1}{:>14}{:>22}{mark}",
            pair.designed.distance_n,
            100.0 * pair.designed.share,
            pair.designed.discrimination,
            seconds(pair.designed.needed_s),
            seconds(pair.road.needed_s),
        );
    }
    text += "  forces differ by: root mean square, after a refit of the model and of the rival; share: part of the effect's change that the\n  rival \
             cannot take, 10 % are needed; expected: in standard deviations, 1.6 are needed\n\n";
    let mut sizes: Vec<String> = Vec::new();
    for pair in &design.pairs {
        let values: Vec<String> = parameters(pair, outcome.drive)
            .map(|(name, value, unit)| format!("{name} {} {unit}", short(value)).trim_end().to_owned())
            .collect();
        let source = if pair.size_is_known { "from the model" } else { "typical" };
        let size = format!("{} with {} ({source})", pair.truth.effect().title(), values.join(", "));
        if !sizes.contains(&size) {
            sizes.push(size);
        }
    }
    let _ = writeln!(text, "Assumed: {}; {}.", sizes.join("; "), noise(design));
    if let Some(rise_k) = design.assumed_rise_k {
        let _ = writeln!(text, "Assumed: the case warms by {rise_k} K during the run; log its temperature.");
    }
    let reached = &design.reached;
    let drive = reached.drive.map_or_else(String::new, |[low, high]| {
        format!(", drive {} to {} {}", short(low), short(high), outcome.drive.map_or("", DriveKind::unit))
    });
    let _ = writeln!(
        text,
        "Reached: {} of {} mm to either side, {} of {} m/s, {} of {} m/s²{drive}.",
        short(1e3 * reached.stroke_m),
        short(1e3 * limits.stroke_m),
        short(reached.speed_m_s),
        short(limits.speed_m_s),
        short(reached.acceleration_m_s2),
        short(limits.acceleration_m_s2),
    );
    for note in &outcome.notes {
        let _ = writeln!(text, "{note}");
    }
    text += "\nSegments\n";
    for segment in &design.segments {
        let _ = writeln!(text, "  {:>6.2} s  {}", segment.start_s, segment.what);
    }
    if let Some(split_s) = design.split_s {
        let _ = writeln!(
            text,
            "\nPlay the run on the damper and record it. The part before {split_s:.2} s is a training run (--estimate), the part after it a \
             validation\nrun (--confirm)."
        );
    }
    text
}

/// The noise that `design` assumes, in words.
fn noise(design: &Design) -> String {
    let source = design.noise_source.in_words();
    let remedy = if design.noise_source == NoiseSource::Given { "" } else { "; --noise sets it" };
    format!("noise and misfit {} N ({source}{remedy})", short(design.noise_n))
}

fn seconds(seconds: f64) -> String {
    match seconds {
        s if s < 0.1 => "0.1 s".to_owned(),
        s if s < 10.0 => format!("{s:.1} s"),
        s if s < 1e4 => format!("{s:.0} s"),
        _ => "never".to_owned(),
    }
}

/// A value with three significant digits.
fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let digits = (2 - value.abs().log10().floor() as i32).clamp(0, 9) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_model::diagnose::design::{PlannedSegment, Reached};
    use mr_damper_model::effect::{Effect, EffectModel};
    use mr_damper_model::sample::Run;

    fn outcome() -> DesignOutcome {
        let separation = |distance_n, share, discrimination, needed_s| Separation {
            alone_n: 5.5,
            distance_n,
            share,
            discrimination,
            probability: 0.999,
            needed_s,
        };
        let pair = |effect: Effect, size: f64, rival, designed, road| Pair {
            truth: EffectModel::new(effect, &[size]).expect("in range"),
            size_is_known: effect == Effect::Friction,
            rival: Some(rival),
            designed,
            is_checked: true,
            road,
        };
        let limits = Limits { drive: Some([0.0, 2.0]), ..Limits::default() };
        DesignOutcome {
            model: "damper+.toml".to_owned(),
            drive: Some(DriveKind::CoilCurrent),
            question: Question::parse("friction|gas_spring").expect("known"),
            limits,
            design: Design {
                run: Run::default(),
                road: Run::default(),
                pairs: vec![
                    pair(
                        Effect::Friction,
                        80.0,
                        "gas_spring",
                        separation(5.25, 0.76, 5.7, 2.5),
                        separation(0.69, 0.9, 1.5, 36.1),
                    ),
                    pair(
                        Effect::GasSpring,
                        4392.2,
                        "friction",
                        separation(0.3, 0.02, 1.2, 56.0),
                        separation(0.0, 0.0, 0.0, f64::INFINITY),
                    ),
                ],
                segments: vec![PlannedSegment {
                    start_s: 0.25,
                    duration_s: 1.64,
                    what: "strokes of 1.76 mm, up to 0.006 m/s; 0 A".to_owned(),
                }],
                reached: Reached {
                    stroke_m: 0.0196,
                    speed_m_s: 0.147,
                    acceleration_m_s2: 9.8,
                    drive: Some([0.0, 2.0]),
                },
                noise_n: 3.59,
                noise_source: NoiseSource::Model,
                moving_s: 28.9,
                split_s: Some(19.916),
                assumed_rise_k: None,
            },
            run: "next.csv".to_owned(),
            seed: 0,
            notes: vec!["A note.".to_owned()],
        }
    }

    #[test]
    fn the_text_names_each_pair_with_its_figures() {
        insta::assert_snapshot!(text(&outcome()));
    }

    #[test]
    fn the_json_has_null_for_a_time_that_is_never_enough() {
        let json = serde_json::to_value(json(&outcome())).expect("JSON");
        assert_eq!(json["schema"], "mr-damper/design/1");
        assert_eq!(json["pairs"][1]["road"]["needed_s"], serde_json::Value::Null);
        assert_eq!(json["pairs"][0]["parameters"]["friction_n"], 80.0);
        assert_eq!(
            [&json["pairs"][0]["separated"], &json["pairs"][1]["separated"]],
            [&true.into(), &serde_json::Value::from(false)]
        );
    }
}
