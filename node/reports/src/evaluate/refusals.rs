//! Refused samples of a run: how many of each channel, why, and what to do.

use mr_damper_base::shown;
use mr_damper_model::pipeline::{Plausible, Refusal, Refused};
use mr_damper_model::sample::{Channel, DriveKind, Reading, Run, Trace};
use serde::Serialize;

/// Samples of one channel that were refused for the same reason.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct RefusedSamples {
    /// Name of the channel.
    channel: &'static str,
    /// The reason, as the name of a counter.
    reason: &'static str,
    /// Number of these samples.
    samples: u64,
    /// Number of all samples of the channel.
    of: u64,
    #[serde(skip)]
    first: Refusal,
}

/// The refused samples of a run by channel and reason, in the order in which they first occur.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Refusals(Vec<RefusedSamples>);

impl Refusals {
    /// Counts a refused sample of `run`.
    pub fn take(&mut self, refusal: &Refusal, run: &Run) {
        let (channel, why) = (refusal.sample.reading.channel(), refusal.why);
        match self.0.iter_mut().find(|known| known.channel == channel.name() && known.first.why == why) {
            Some(known) => known.samples += 1,
            None => self.0.push(RefusedSamples {
                channel: channel.name(),
                reason: why.name(),
                samples: 1,
                of: run.trace(channel).map_or(0, Trace::len) as u64,
                first: *refusal,
            }),
        }
    }

    /// True if no sample was refused.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Number of refused samples of `channel`.
    #[must_use]
    pub fn samples(&self, channel: Channel) -> u64 {
        self.of_channel(channel).map(|refused| refused.samples).sum()
    }

    /// True if `channel` has samples and all of them were refused.
    #[must_use]
    pub fn is_all_of(&self, channel: Channel) -> bool {
        self.of_channel(channel).next().is_some_and(|refused| refused.of == self.samples(channel))
    }

    /// For each channel and reason: how many samples were refused, why, what it means, and what to do.
    pub fn texts(&self) -> impl Iterator<Item = String> {
        self.0.iter().map(RefusedSamples::text)
    }

    fn of_channel(&self, channel: Channel) -> impl Iterator<Item = &RefusedSamples> {
        self.0.iter().filter(move |refused| refused.channel == channel.name())
    }
}

impl RefusedSamples {
    fn text(&self) -> String {
        let Refusal { sample, why } = self.first;
        let reading = sample.reading;
        let limit = limit(reading, why).map_or_else(String::new, |limit| format!("the limit is {limit}; "));
        let parts = [
            format!(
                "{} of {} of the {} refused: {} ({limit}the first is {} {} at {} s).",
                self.samples,
                shown::count(self.of, "sample"),
                words(reading),
                why.text(),
                reading.get(),
                unit(reading),
                sample.stamp.nanos() as f64 / 1e9,
            ),
            consequence(reading).to_owned(),
            advice(reading, why),
        ];
        let parts: Vec<&str> = parts.iter().map(String::as_str).filter(|part| !part.is_empty()).collect();
        parts.join(" ")
    }
}

/// The channel of `reading` in words.
fn words(reading: Reading) -> String {
    match reading {
        Reading::Drive(drive) => drive.kind().in_words().to_owned(),
        other => other.channel().name().replace('_', " "),
    }
}

const fn unit(reading: Reading) -> &'static str {
    match reading {
        Reading::Displacement(_) => "m",
        Reading::Velocity(_) | Reading::BodyVelocity(_) => "m/s",
        Reading::Drive(drive) => drive.kind().unit(),
        Reading::Force(_) | Reading::ForceRequest(_) => "N",
        Reading::CaseTemperature(_) => "°C",
    }
}

/// The limit that `reading` exceeds, with its unit; `None` if there is no single number.
fn limit(reading: Reading, why: Refused) -> Option<String> {
    let most = Plausible::default();
    match (why, reading) {
        (Refused::TooFast, _) | (Refused::OutOfRange, Reading::Velocity(_) | Reading::BodyVelocity(_)) => {
            Some(format!("{} m/s", most.speed_max_m_s))
        }
        (Refused::OutOfRange, Reading::Displacement(_)) => Some(format!("{} m", most.displacement_max_m)),
        (Refused::OutOfRange, Reading::Force(_) | Reading::ForceRequest(_)) => {
            Some(format!("{} N", most.force_max_n))
        }
        _ => None,
    }
}

/// What the model does without the sample; empty if it hardly matters.
const fn consequence(reading: Reading) -> &'static str {
    match reading {
        Reading::Displacement(_) => "The model has no force there.",
        Reading::Drive(_) => {
            "The simulation uses the last accepted value in their place, so its forces and errors there mean little."
        }
        Reading::Force(_) => "They are not compared with the model.",
        _ => "",
    }
}

fn advice(reading: Reading, why: Refused) -> String {
    let unit = format!(
        "Check the unit: the name of a column ends in it, as in {}, and --map takes unit=U and offset=X.",
        in_another_unit(reading)
    );
    match why {
        Refused::OutOfRange => unit,
        Refused::TooFast => format!("{unit} Also check the recording for spikes."),
        Refused::NotFinite => "Check the recording for missing readings.".to_owned(),
        Refused::Repeated | Refused::TimeBack => {
            "Check the stamps of the recording: they must increase.".to_owned()
        }
        Refused::Ahead => "Check the clocks of the recording.".to_owned(),
        Refused::WrongDrive => "Use a model that was identified on this kind of drive.".to_owned(),
    }
}

/// A column of the channel in a unit other than that of the SI.
const fn in_another_unit(reading: Reading) -> &'static str {
    match reading {
        Reading::Displacement(_) => "displacement_mm",
        Reading::Velocity(_) => "velocity_mm_s",
        Reading::BodyVelocity(_) => "body_velocity_mm_s",
        Reading::Force(_) => "force_kn",
        Reading::ForceRequest(_) => "force_request_kn",
        Reading::CaseTemperature(_) => "case_temp_f",
        Reading::Drive(drive) => match drive.kind() {
            DriveKind::CoilCurrent => "current_ma",
            DriveKind::CommandVoltage => "command_mv",
        },
    }
}

#[cfg(test)]
mod tests {
    use crate::evaluate::{RunReport, figures};
    use mr_damper_model::preset;
    use mr_damper_model::rig::{Channels, Experiment, Plant, record};
    use mr_damper_model::sample::{Channel, Run};

    fn run() -> Run {
        record(&Experiment::sine(0.01, 2.0, 1.5, 1.0), &Plant::default(), &Channels::default(), 1)
    }

    fn report(run: &Run) -> RunReport {
        let model = preset::load(preset::BEST_FUZZY_TANH).expect("a preset");
        figures("run".to_owned(), model, run).expect("figures")
    }

    #[test]
    fn a_run_with_correct_units_has_no_refused_samples() {
        let found = report(&run());
        assert!(found.refusals.is_empty() && found.refused == 0, "{found:?}");
        assert!(!found.refusals.is_all_of(Channel::Displacement));
    }

    #[test]
    fn currents_in_milliamperes_are_counted_and_explained() {
        let mut run = run();
        if let Some((_, trace)) = &mut run.drive {
            trace.values.iter_mut().for_each(|value| *value = 1500.0);
        }
        let found = report(&run);
        assert!(found.refusals.is_all_of(Channel::Drive), "{found:?}");
        assert_eq!(found.refused, found.refusals.samples(Channel::Drive));
        let texts: Vec<String> = found.refusals.texts().collect();
        assert_eq!(texts.len(), 1, "{texts:?}");
        for word in ["samples of the coil current refused", "the first is 1500 A at", "current_ma"] {
            assert!(texts.iter().all(|text| text.contains(word)), "{word}: {texts:?}");
        }
    }

    #[test]
    fn displacements_in_millimetres_are_counted_and_explained() {
        let mut run = run();
        run.displacement_m.values.iter_mut().for_each(|value| *value = 12.5);
        let found = report(&run);
        assert!(found.refusals.is_all_of(Channel::Displacement) && found.free_run.is_none(), "{found:?}");
        let text: String = found.refusals.texts().collect();
        for word in
            ["the limit is 1 m; the first is 12.5 m", "The model has no force there", "displacement_mm"]
        {
            assert!(text.contains(word), "{word}: {text}");
        }
        let json = serde_json::to_value(&found.refusals).expect("JSON");
        assert_eq!(json.pointer("/0/reason"), Some(&"out_of_range".into()), "{json}");
    }
}
