//! Status of the model: the residual of the simulation (free run), and its alarm.

use super::{StatusContext, value};
use mr_damper_base::alarm::ADVICE;
use mr_damper_base::clock::in_seconds;
use mr_damper_model::pipeline::{AlarmChange, Event, Residual};
use mr_damper_msgs::standard::DiagnosticStatus;
use std::time::{Duration, Instant};

/// A residual older than this counts as missing.
const SILENCE: Duration = Duration::from_secs(2);

/// The last residual, and the alarm.
#[derive(Debug, Clone, Default)]
pub struct Health {
    residual: Option<(Residual, Instant)>,
    /// The event that raised the alarm, while the alarm lasts.
    alarm: Option<AlarmChange>,
}

impl Health {
    /// Takes an event that happened `at`.
    pub fn take(&mut self, event: &Event, at: Instant) {
        match event {
            Event::Residual(residual) => self.residual = Some((*residual, at)),
            Event::Alarm(change) => self.alarm = change.raised.then_some(*change),
            Event::Input(_)
            | Event::Refusal(_)
            | Event::Estimate(_)
            | Event::Transition(_)
            | Event::Command(_) => {}
        }
    }

    /// The status at `now`.
    #[must_use]
    pub fn residual_status(&self, now: Instant, context: &StatusContext<'_>) -> DiagnosticStatus {
        let (level, message) = self.verdict(now);
        let mut values = vec![
            value("model", &context.names.free),
            value("alarm", if self.alarm.is_some() { "true" } else { "false" }),
            value("false_alarm_interval_s", context.false_alarm_interval_s),
            value("history_s", format_args!("{:.1}", context.history_s)),
        ];
        if let Some((residual, _)) = &self.residual {
            let figures = [
                ("windowed_rsse_n", residual.windowed_rsse.get()),
                ("expected_rsse_n", residual.expected_rsse.get()),
                ("ratio", ratio(residual)),
                ("windowed_esr", residual.windowed_esr),
            ];
            values.extend(figures.map(|(key, figure)| value(key, format_args!("{figure:.4}"))));
        }
        if let Some(alarm) = &self.alarm {
            values.push(value("alarm_since_s", in_seconds(alarm.stamp)));
        }
        DiagnosticStatus {
            level,
            name: format!("{}: residual", context.node),
            message,
            hardware_id: context.damper.to_owned(),
            values,
        }
    }

    fn verdict(&self, now: Instant) -> (u8, String) {
        let Some((residual, at)) = &self.residual else {
            let message =
                "no residual yet: it needs measured_force at the stamps of displacement, and an estimate";
            return (DiagnosticStatus::STALE, message.to_owned());
        };
        let age = now.saturating_duration_since(*at);
        if age > SILENCE {
            let message = format!(
                "no residual for {:.0} s: measured_force or displacement is silent",
                age.as_secs_f64()
            );
            return (DiagnosticStatus::STALE, message);
        }
        let ratio = ratio(residual);
        if let Some(alarm) = &self.alarm {
            let message = format!(
                "the model no longer fits: the RMSE of its residual is {ratio:.2} times the expected value, alarm since {} s; {ADVICE}",
                in_seconds(alarm.stamp)
            );
            return (DiagnosticStatus::WARN, message);
        }
        let message = if ratio.is_nan() {
            "the model file contains no expected RMSE, so the alarm is off".to_owned()
        } else {
            format!("the RMSE of the residual is {ratio:.2} times the expected value; no alarm")
        };
        (DiagnosticStatus::OK, message)
    }
}

fn ratio(residual: &Residual) -> f64 {
    residual.windowed_rsse.get() / residual.expected_rsse.get()
}

#[cfg(test)]
mod tests {
    use super::super::context;
    use super::*;
    use crate::estimation::wire::ModelNames;
    use mr_damper_model::sample::Stamp;
    use mr_damper_model::units::{Newton, Second};
    use std::fmt::Write;

    fn residual(rsse_n: f64, expected_n: f64) -> Event {
        Event::Residual(Residual {
            stamp: Stamp::from_nanos(1_700_000_000_250_000_000),
            measured: Newton(100.0),
            predicted: Newton(90.0),
            load_cell: Newton(0.0),
            residual: Newton(10.0),
            expected_rsse: Newton(expected_n),
            normalised: 10.0 / expected_n,
            windowed_rsse: Newton(rsse_n),
            windowed_esr: 0.0123,
            window: Second(5.0),
            counts: true,
            alarm: false,
        })
    }

    fn change(raised: bool) -> Event {
        Event::Alarm(AlarmChange { stamp: Stamp::from_nanos(1_700_000_000_250_000_000), raised, ratio: 3.0 })
    }

    #[test]
    fn statuses_as_text() {
        let begin = Instant::now();
        let names = ModelNames { free: "thesis/fuzzy-tanh/rp3-cs".to_owned(), ..ModelNames::default() };
        let context = context(&names);
        let script: [(&str, &[Event], u64); 6] = [
            ("at the start", &[], 0),
            ("as good as expected", &[residual(52.0, 50.0)], 0),
            ("the alarm rises", &[change(true), residual(150.0, 50.0)], 1),
            ("measured force stops", &[], 4),
            ("it comes again, and the alarm falls", &[change(false), residual(49.0, 50.0)], 5),
            ("a model without an expectation", &[residual(49.0, f64::NAN)], 6),
        ];
        let (mut health, mut text) = (Health::default(), String::new());
        for (what, events, at_s) in script {
            let now = begin + Duration::from_secs(at_s);
            for event in events {
                health.take(event, now);
            }
            let status = health.residual_status(now, &context);
            writeln!(
                text,
                "{what}: {} {} [{}] {}",
                status.level, status.name, status.hardware_id, status.message
            )
            .expect("a text");
            let values: Vec<_> = status.values.iter().map(|v| format!("{}={}", v.key, v.value)).collect();
            writeln!(text, "    {}", values.join(" ")).expect("a text");
        }
        insta::assert_snapshot!(text, @"
        at the start: 3 /front_left/mr_damper: residual [front_left] no residual yet: it needs measured_force at the stamps of displacement, and an estimate
            model=thesis/fuzzy-tanh/rp3-cs alarm=false false_alarm_interval_s=86400 history_s=120.0
        as good as expected: 0 /front_left/mr_damper: residual [front_left] the RMSE of the residual is 1.04 times the expected value; no alarm
            model=thesis/fuzzy-tanh/rp3-cs alarm=false false_alarm_interval_s=86400 history_s=120.0 windowed_rsse_n=52.0000 expected_rsse_n=50.0000 ratio=1.0400 windowed_esr=0.0123
        the alarm rises: 1 /front_left/mr_damper: residual [front_left] the model no longer fits: the RMSE of its residual is 3.00 times the expected value, alarm since 1700000000.250 s; find what the model lacks with `mr-damper close --live` (action close_loop) or with `mr-damper close` on recorded runs, and load the new model with load_model
            model=thesis/fuzzy-tanh/rp3-cs alarm=true false_alarm_interval_s=86400 history_s=120.0 windowed_rsse_n=150.0000 expected_rsse_n=50.0000 ratio=3.0000 windowed_esr=0.0123 alarm_since_s=1700000000.250
        measured force stops: 3 /front_left/mr_damper: residual [front_left] no residual for 3 s: measured_force or displacement is silent
            model=thesis/fuzzy-tanh/rp3-cs alarm=true false_alarm_interval_s=86400 history_s=120.0 windowed_rsse_n=150.0000 expected_rsse_n=50.0000 ratio=3.0000 windowed_esr=0.0123 alarm_since_s=1700000000.250
        it comes again, and the alarm falls: 0 /front_left/mr_damper: residual [front_left] the RMSE of the residual is 0.98 times the expected value; no alarm
            model=thesis/fuzzy-tanh/rp3-cs alarm=false false_alarm_interval_s=86400 history_s=120.0 windowed_rsse_n=49.0000 expected_rsse_n=50.0000 ratio=0.9800 windowed_esr=0.0123
        a model without an expectation: 0 /front_left/mr_damper: residual [front_left] the model file contains no expected RMSE, so the alarm is off
            model=thesis/fuzzy-tanh/rp3-cs alarm=false false_alarm_interval_s=86400 history_s=120.0 windowed_rsse_n=49.0000 expected_rsse_n=NaN ratio=NaN windowed_esr=0.0123
        ");
    }
}
