//! Current commands of the pipeline: control laws, stale requests, silence, changes while it runs; and the observer.

use crate::common::{Harness, PERIOD_NS, for_method, force_n, preset, samples};
use mr_damper_model::inverse::{ControlLaw, LimitedBy, Limits, Method, SkyhookGains};
use mr_damper_model::pipeline::{Event, Models, Pipeline, PipelineSetup, Settings, StampedCommand, UseForce};
use mr_damper_model::preset::{BEST_ARX, BEST_FUZZY_TANH};
use mr_damper_model::sample::{Reading, Sample, Stamp};
use mr_damper_model::units::{MetrePerSecond, Newton};
use std::ops::Range;

fn fuzzy_tanh() -> Models {
    Models::alone(preset(BEST_FUZZY_TANH))
}

/// A pipeline with the commands that it gave.
struct CommandHarness {
    pipeline: Pipeline,
    commands: Vec<StampedCommand>,
}

impl CommandHarness {
    fn new(models: Models, settings: Settings) -> Self {
        Self { pipeline: Pipeline::new(models, settings).expect("it runs"), commands: Vec::new() }
    }

    fn feed(&mut self, sample: &Sample) {
        let commands = &mut self.commands;
        self.pipeline.step(sample, &mut |event| {
            if let Event::Command(commanded) = event {
                commands.push(commanded);
            }
        });
    }

    /// Feeds motion without measured force, and the reading of `request` with each sample's stamp.
    fn run(&mut self, range: Range<i64>, request: impl Fn(i64) -> Option<Reading>) -> &mut Self {
        for k in range {
            let [drive, _, displacement] = samples(k, 0);
            for sample in
                request(k).map(|reading| Sample { reading, ..drive }).into_iter().chain([displacement])
            {
                self.feed(&sample);
            }
        }
        self
    }

    fn tick(&mut self, ms: i64) {
        let commands = &mut self.commands;
        self.pipeline.tick(Stamp::from_nanos(ms * 1_000_000), &mut |event| {
            if let Event::Command(commanded) = event {
                commands.push(commanded);
            }
        });
    }

    fn last(&self) -> &StampedCommand {
        self.commands.last().expect("a command")
    }

    fn currents_a(&self) -> Vec<f64> {
        self.commands.iter().map(|commanded| commanded.command.current.get()).collect()
    }
}

/// A request for a force along the motion that the thesis' damper can give.
fn achievable_request(k: i64) -> Option<Reading> {
    Some(Reading::ForceRequest(Newton(0.9 * force_n(k))))
}

#[test]
fn commands_start_with_the_first_request() {
    let mut damper = CommandHarness::new(fuzzy_tanh(), Settings::default());
    damper.run(0..100, |_| None);
    assert!(damper.commands.is_empty());
    damper.run(100..600, achievable_request);
    assert_eq!(damper.commands.len(), 500, "one per displacement");
    let stamps: Vec<_> = (100..600).map(|k| samples(k, 0)[2].stamp).collect();
    assert_eq!(damper.commands.iter().map(|c| c.stamp).collect::<Vec<_>>(), stamps);
    let met = damper.commands.iter().filter(|c| c.command.limited_by == LimitedBy::None).count();
    assert!(met > 300, "{met} of 500 are met");
    assert!(damper.currents_a().iter().all(|a| (0.0..=2.5).contains(a)));
    let mut off = CommandHarness::new(fuzzy_tanh(), Settings { law: ControlLaw::Off, ..Settings::default() });
    assert!(off.run(0..100, achievable_request).commands.is_empty());
}

#[test]
fn a_request_that_stops_or_is_not_finite_leads_to_the_safe_current() {
    let limits = Limits { safe_a: 0.3, safe_after_s: 0.2, ..Limits::default() };
    let settings = Settings { limits, request_timeout_s: 0.05, ..Settings::default() };
    let hard = |_| Some(Reading::ForceRequest(Newton(5000.0)));
    // The request times out after 0.05 s; 0.2 s later the current is the safe one.
    let mut damper = CommandHarness::new(fuzzy_tanh(), settings);
    damper.run(0..300, hard).run(300..460, |_| None);
    let says = |k: usize| damper.commands[k].command.limited_by;
    assert_eq!((says(320), says(330)), (LimitedBy::CurrentMax, LimitedBy::Safe), "25 samples are 49 ms");
    let currents_a = damper.currents_a();
    let falling = &currents_a[326..];
    assert!(falling.windows(2).all(|pair| pair[1] <= pair[0]) && falling[0] > 2.0, "{falling:?}");
    assert!(currents_a[400] > 0.3 && currents_a[430] == 0.3, "{falling:?}");
    // NaN ends the request at once.
    let mut damper = CommandHarness::new(fuzzy_tanh(), settings);
    damper.run(0..300, hard).run(300..302, |_| Some(Reading::ForceRequest(Newton(f64::NAN))));
    assert_eq!(damper.last().command.limited_by, LimitedBy::Safe);
    assert!(damper.last().command.requested.get().is_nan());
}

/// The request has the stamp of the motion, so only the arrival shows that both are old.
#[test]
fn a_motion_that_arrives_late_gets_the_safe_current() {
    let limits = Limits { safe_a: 0.3, safe_after_s: 0.2, ..Limits::default() };
    let settings = Settings { limits, request_timeout_s: 0.05, ..Settings::default() };
    let after = |delay_ms: i64| {
        let mut damper = CommandHarness::new(fuzzy_tanh(), settings);
        for k in 0..400 {
            let [drive, _, displacement] = samples(k, 0);
            let request = Sample { reading: Reading::ForceRequest(Newton(5000.0)), ..drive };
            for sample in [request, displacement] {
                damper.feed(&Sample { received: sample.stamp.shifted(delay_ms * 1_000_000), ..sample });
            }
        }
        (damper.last().command.limited_by, damper.last().command.current.get())
    };
    assert_eq!(after(40), (LimitedBy::CurrentMax, 2.5));
    assert_eq!(after(60), (LimitedBy::Safe, 0.3));
    assert_eq!(after(10_000), (LimitedBy::Safe, 0.3));
}

/// Ticks report the current during silence and do not change the state: the commands after them are the same without ticks.
#[test]
fn during_silence_the_current_moves_to_the_safe_one() {
    let settings =
        Settings { limits: Limits { safe_after_s: 0.4, ..Limits::default() }, ..Settings::default() };
    let hard = |_| Some(Reading::ForceRequest(Newton(5000.0)));
    let run = |ticks: bool| {
        let mut damper = CommandHarness::new(fuzzy_tanh(), settings);
        damper.run(0..300, hard);
        let fed = damper.commands.len();
        if ticks {
            for ms in (600..880).step_by(20) {
                damper.tick(ms);
            }
        }
        let ticked = damper.commands.split_off(fed);
        // Displacement resumes at 893 ms.
        damper.run(457..467, |_| None);
        (ticked, damper.commands.split_off(fed))
    };
    let ((ticked, after), (none, without)) = (run(true), run(false));
    assert!(none.is_empty());
    let plain = |commands: &[StampedCommand]| -> Vec<_> {
        commands.iter().map(|c| (c.stamp, c.command.current)).collect()
    };
    assert_eq!(plain(&after), plain(&without));
    assert!((0.6..1.4).contains(&after[0].command.current.get()), "half way to the safe current: {after:?}");
    // Displacement ended at 584 ms; it counts for another 100 ms.
    let at = |ms: i64| {
        ticked.iter().rfind(|c| c.stamp <= Stamp::from_nanos(ms * 1_000_000)).map(|c| c.command.current.get())
    };
    assert_eq!(at(680), None);
    // The last tick is at 860 ms, after 276 ms of silence, of which 176 ms count.
    let middle_a = at(879).expect("a command by then");
    assert!((middle_a - (2.5 - 0.176 * 2.5 / 0.4)).abs() < 1e-3, "{middle_a}");
    assert!(ticked.iter().all(|c| c.command.limited_by == LimitedBy::Safe));
    let stamps: Vec<_> = ticked.iter().map(|c| c.stamp).collect();
    assert!(stamps.is_sorted_by(|a, b| a < b), "{stamps:?}");
}

#[test]
fn hooks_demand_a_force_from_the_body_velocity() {
    let body = |k: i64| Some(Reading::BodyVelocity(MetrePerSecond(0.3 * (k as f64 / 40.0).sin())));
    for (law, sign) in [(ControlLaw::Skyhook(1500.0), 1.0), (ControlLaw::Groundhook(1500.0), -1.0)] {
        let mut damper = CommandHarness::new(fuzzy_tanh(), Settings { law, ..Settings::default() });
        damper.run(0..800, body);
        assert_eq!(damper.commands.len(), 800);
        let counted = damper.commands.iter().filter(|c| c.command.dissipative).count();
        assert!((200..700).contains(&counted), "{law:?}: {counted}");
        for (k, commanded) in damper.commands.iter().enumerate().skip(10) {
            let command = &commanded.command;
            if law == ControlLaw::Skyhook(1500.0) {
                let requested_n = sign * 450.0 * (k as f64 / 40.0).sin();
                assert!((command.requested.get() - requested_n).abs() < 1e-9);
            }
            assert!(command.dissipative || command.limited_by != LimitedBy::None, "{command:?}");
        }
        // Without the body velocity the law has no demand.
        damper.run(800..900, |_| None);
        assert_eq!(damper.last().command.limited_by, LimitedBy::Safe);
    }
}

/// exp(-(i - c)^2 / (2 s^2)) with s of half the distance of two currents.
fn blended(current_a: f64, [low, high]: [f64; 2], [at_low, at_high]: [f64; 2]) -> f64 {
    let sigma = 0.5 * (at_high - at_low);
    let strength = |centre: f64| f64::exp(-0.5 * ((current_a - centre) / sigma).powi(2));
    (strength(at_low) * low + strength(at_high) * high) / (strength(at_low) + strength(at_high))
}

#[test]
fn the_damping_of_skyhook_follows_the_current() {
    let (gains, centres) = ([2000.0, 800.0], [0.5, 1.5]);
    let law = ControlLaw::SkyhookGains(SkyhookGains::new(&gains, &centres));
    let body_m_s = |k: i64| 0.3 * (k as f64 / 40.0).sin();
    // The current is not measured, so the last commanded one counts.
    let mut damper = CommandHarness::new(fuzzy_tanh(), Settings { law, ..Settings::default() });
    damper.run(0..800, |k| Some(Reading::BodyVelocity(MetrePerSecond(body_m_s(k)))));
    let mut dampings = Vec::new();
    for (k, pair) in damper.commands.windows(2).enumerate().skip(10) {
        let body_m_s = body_m_s(k as i64 + 1);
        let damping = blended(pair[0].command.current.get(), gains, centres);
        let requested_n = pair[1].command.requested.get();
        assert!((requested_n - damping * body_m_s).abs() < 1e-6, "{k}: {requested_n} {damping}");
        dampings.push(damping);
    }
    let most = dampings.iter().fold(0.0_f64, |most, c| most.max(*c));
    let least = dampings.iter().fold(f64::INFINITY, |least, c| least.min(*c));
    assert!(most > 1900.0 && least < 1000.0, "{least} to {most}");
    // A measured current counts.
    let mut damper = CommandHarness::new(fuzzy_tanh(), Settings { law, ..Settings::default() });
    for k in 0..100 {
        let [drive, _, displacement] = samples(k, 0);
        let reading = Reading::BodyVelocity(MetrePerSecond(0.2));
        for sample in [drive, Sample { reading, ..drive }, displacement] {
            damper.feed(&sample);
        }
        let Reading::Drive(drive) = drive.reading else { panic!("a drive") };
        let requested_n = damper.last().command.requested.get();
        assert!((requested_n - 0.2 * blended(drive.get(), gains, centres)).abs() < 1e-6 || k == 0);
    }
    // Lists that do not fit are refused before they run.
    let law = ControlLaw::SkyhookGains(SkyhookGains::new(&gains, &[0.5, 1.5, 2.0]));
    let refused = PipelineSetup::new(fuzzy_tanh(), Settings { law, ..Settings::default() });
    let text = refused.expect_err("two gains at three currents").to_string();
    assert!(text.contains("skyhook.gains_n_s_m has 2 values"), "{text}");
}

#[test]
fn a_fixed_current_needs_no_inverse_and_no_motion() {
    let settings = Settings { law: ControlLaw::Fixed(1.5), ..Settings::default() };
    for models in [fuzzy_tanh(), Models::alone(preset("thesis/arx-passive/rp-icps"))] {
        let mut damper = CommandHarness::new(models, settings);
        damper.run(0..50, |_| None);
        damper.tick(400);
        assert_eq!(damper.commands.len(), 51);
        assert!(damper.currents_a().iter().skip(1).all(|a| *a == 1.5), "{:?}", damper.currents_a());
        assert!(damper.commands.iter().skip(1).all(|c| c.command.limited_by == LimitedBy::None));
    }
}

#[test]
fn a_model_without_an_inverse_reports_no_inverse() {
    let passive = Models::alone(preset("thesis/arx-passive/rp-icps"));
    let mut damper = CommandHarness::new(passive, Settings::default());
    damper.run(0..50, achievable_request);
    let command = damper.last().command;
    assert_eq!((command.limited_by, command.current.get()), (LimitedBy::NoInverse, 0.0));
    assert!((command.requested.get() - 0.9 * force_n(49)).abs() < 1e-9);
    let hook = Settings { law: ControlLaw::Skyhook(1500.0), ..Settings::default() };
    let refused = PipelineSetup::new(passive, hook).expect_err("a hook needs an inverse").to_string();
    assert!(refused.starts_with("law skyhook: no inverse of the arx model"), "{refused}");
    let beyond = Settings { law: ControlLaw::Fixed(3.0), ..Settings::default() };
    assert!(
        PipelineSetup::new(passive, beyond)
            .expect_err("above the limit")
            .to_string()
            .contains("fixed.current_a is 3")
    );
}

#[test]
fn every_inverse_method_gives_commands_within_limits_and_rejects_models_it_cannot_approximate() {
    let limits = Limits { current_max_a: 2.0, rate_max_a_s: 40.0, ..Limits::default() };
    let by = |method| Settings { method, limits, ..Settings::default() };
    let models = |method| Models::alone(for_method(preset(BEST_FUZZY_TANH), method));
    let currents = Method::ALL.map(|method| {
        let mut damper = CommandHarness::new(models(method), by(method));
        damper.run(0..600, achievable_request);
        let met = damper.commands.iter().filter(|c| c.command.limited_by == LimitedBy::None).count();
        assert!(met > if method.learned().is_some() { 50 } else { 200 }, "{}: {met}", method.name());
        let substituted = damper.commands.iter().filter(|c| c.command.substituted).count();
        assert!(substituted <= 5, "{}: {substituted} at the start", method.name());
        // The model is replaced by itself, and displacement pauses for 100 ms.
        let setup = PipelineSetup::new(models(method), by(method)).expect("it runs");
        damper.pipeline.take(setup, &mut |_| {});
        damper.run(600..800, achievable_request).run(851..1000, achievable_request);
        let currents_a = damper.currents_a();
        let most_a = 40.0 * PERIOD_NS as f64 * 1e-9 + 1e-12;
        assert!(currents_a.iter().all(|a| (0.0..=2.0).contains(a)), "{}", method.name());
        let mut steps = currents_a[..800].windows(2).map(|pair| (pair[1] - pair[0]).abs());
        assert!(steps.all(|step| step <= most_a), "{}", method.name());
        currents_a
    });
    for (k, currents_a) in currents.iter().enumerate() {
        assert!(currents[..k].iter().all(|other| other != currents_a), "{}", Method::ALL[k].name());
    }
    let without =
        PipelineSetup::new(fuzzy_tanh(), by(Method::Chen)).expect_err("no such inverse").to_string();
    assert!(
        without.starts_with("inverse.method chen: ") && without.contains("identify --inverse chen"),
        "{without}"
    );
    let arx = Models::alone(preset(BEST_ARX));
    let refused = PipelineSetup::new(arx, by(Method::Fuzzy)).expect_err("it feeds on force").to_string();
    assert!(refused.starts_with("inverse.method fuzzy: ") && refused.contains("use search"), "{refused}");
}

#[test]
fn after_a_change_of_model_or_limits_the_current_continues_from_its_value() {
    let limits = Limits { rate_max_a_s: 20.0, ..Limits::default() };
    let settings = Settings { limits, ..Settings::default() };
    let mut damper = CommandHarness::new(fuzzy_tanh(), settings);
    damper.run(0..300, |_| Some(Reading::ForceRequest(Newton(5000.0))));
    for setup in [
        PipelineSetup::new(Models::alone(preset("thesis/fuzzy-tanh/rp1-cs")), settings),
        PipelineSetup::new(
            fuzzy_tanh(),
            Settings { limits: Limits { current_max_a: 2.0, ..limits }, ..settings },
        ),
    ] {
        let setup = setup.expect("in range");
        damper.pipeline.take(setup, &mut |_| {});
        let from = damper.commands.len() as i64;
        damper.run(from..from + 100, achievable_request);
    }
    let most_a = 20.0 * PERIOD_NS as f64 * 1e-9 + 1e-12;
    let currents_a = damper.currents_a();
    let steps = currents_a.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    // A lowered limit applies at once, so one larger step is allowed.
    let over = steps.filter(|step| *step > most_a).count();
    assert!(over <= 1, "{over}");
    assert!(currents_a[400..].iter().all(|a| *a <= 2.0));
}

#[test]
fn bad_requests_do_not_change_the_estimate() {
    let forces = |bad: bool| {
        let mut harness = Harness::thesis();
        for k in 0..300 {
            if bad {
                harness.feed_reading(
                    k,
                    Reading::ForceRequest(Newton([f64::NAN, f64::INFINITY, -1e9, 1e4][k as usize % 4])),
                );
            }
            harness.run(k..k + 1, |_| true);
        }
        harness.estimates().map(|e| (e.force.get().to_bits(), e.reasons)).collect::<Vec<_>>()
    };
    assert!(forces(false) == forces(true));
}

/// The observer corrects the estimate towards the measured force; the residual stays the model error without the correction.
#[test]
fn an_observer_corrects_the_estimate_but_not_the_residual() {
    let settings = |use_measured_force| Settings { use_measured_force, ..Settings::default() };
    let run = |use_measured_force| {
        let mut harness = Harness::new(settings(use_measured_force));
        harness.measure_free_run_plus(200.0, 1500);
        harness.run(0..1000, |_| true);
        harness.run(1000..1500, |_| false);
        harness
    };
    let (plain, observed) = (run(UseForce::Never), run(UseForce::Observer(0.1)));
    let residuals =
        |harness: &Harness| harness.residuals().map(|r| r.residual.get().to_bits()).collect::<Vec<_>>();
    assert!(residuals(&plain) == residuals(&observed));
    let added: Vec<f64> = observed
        .estimates()
        .zip(plain.estimates())
        .map(|(with, without)| with.force.get() - without.force.get())
        .collect();
    assert!((added[999] - 200.0).abs() < 1.0, "{}", added[999]);
    let first = 1.0 - (-1.0_f64).exp();
    // One time constant is 51 samples after the first residual.
    assert!((added[54] - 200.0 * first).abs() < 10.0, "{}", added[54]);
    assert!(added[1499].abs() < 10.0, "without measured force the correction decays: {}", added[1499]);
    let steps = added.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
    assert!(steps < 5.0, "{steps}");
}

/// At a change of mode the force added to the simulation (free run) jumps neither in value nor in slope.
#[test]
fn a_change_of_mode_jumps_neither_in_value_nor_in_slope() {
    let settings = Settings { bumpless_tau_s: 0.05, ..Settings::default() };
    let models = fuzzy_tanh().with_seeded(preset(BEST_ARX)).expect("both want a current");
    let mut harness = Harness::new(settings);
    harness.constant_current = true;
    harness.measure_free_run_plus(150.0, 1200);
    harness.run(0..600, |_| true);
    harness.run(600..1200, |_| false);
    assert!(models.seeded.is_some());
    let free = harness.free_run_n();
    let added: Vec<f64> = harness.estimates().zip(&free).map(|(e, free)| e.force.get() - free).collect();
    // The change from ARX to the model, 50 ms + 200 ms after the force was lost.
    let change = harness
        .events
        .iter()
        .filter_map(|event| match event {
            Event::Transition(t) if t.to == mr_damper_model::pipeline::Mode::Model => Some(t.stamp),
            _ => None,
        })
        .next_back()
        .expect("a change to the model");
    let at = (change.nanos() / PERIOD_NS) as usize;
    let value = (added[at] - added[at - 1]).abs();
    assert!(value < 15.0, "value {value}");
    // The jump of the slope, compared with the jump for a plain exponential, d / tau.
    let slope_before = (added[at - 1] - added[at - 6]) * 512.0 / 5.0;
    let slope_after = (added[at + 5] - added[at]) * 512.0 / 5.0;
    let plain = added[at].abs() / settings.bumpless_tau_s;
    assert!((slope_after - slope_before).abs() < 0.6 * plain, "{slope_before} {slope_after} {plain}");
    assert!(added[at + 300].abs() < 0.5, "{}", added[at + 300]);
}
