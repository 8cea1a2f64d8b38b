//! Recording of a service's output, kept in memory for the report.

use mr_damper_model::evaluate::{Evaluation, Evaluator};
use mr_damper_model::metrics::{ErrorSum, Fit};
use mr_damper_model::pipeline::{
    AlarmChange, Estimate, Event, Mode, Reasons, Residual, Transition, Validity,
};
use mr_damper_model::sample::{Channel, Stamp, Trace};

/// All events that were received from the service.
#[derive(Debug, Clone, Default)]
pub struct Recording {
    inputs: [Trace; Channel::ALL.len()],
    /// Estimates, in order.
    pub estimates: Vec<Estimate>,
    /// Residuals, in order.
    pub residuals: Vec<Residual>,
    /// Changes of mode, in order.
    pub transitions: Vec<Transition>,
    /// Changes of the alarm (raised or ended), in order.
    pub alarms: Vec<AlarmChange>,
    evaluator: Evaluator,
    zero: Option<Stamp>,
}

/// A period in which the mode did not change.
#[derive(Debug, Clone, PartialEq)]
pub struct Period {
    /// Begin and end, in seconds since the first sample.
    pub span_s: (f64, f64),
    /// The mode.
    pub mode: Mode,
    /// Why it was entered.
    pub cause: &'static str,
    /// Number of estimates in the period.
    pub estimates: usize,
    /// The worst validity of these estimates.
    pub worst: Validity,
    /// All reasons that these estimates gave.
    pub reasons: Reasons,
}

impl Recording {
    /// Records an event.
    pub fn take(&mut self, event: &Event) {
        self.evaluator.take(event, |_| true);
        match event {
            Event::Input(sample) => {
                self.zero.get_or_insert(sample.stamp);
                let trace = &mut self.inputs[sample.reading.channel() as usize];
                trace.stamps.push(sample.stamp);
                trace.values.push(sample.reading.get());
            }
            Event::Estimate(estimate) => self.estimates.push(*estimate),
            Event::Residual(residual) => self.residuals.push(*residual),
            Event::Transition(transition) => self.transitions.push(*transition),
            Event::Alarm(change) => self.alarms.push(*change),
            Event::Refusal(_) | Event::Command(_) => {}
        }
    }

    /// The accepted samples of one channel.
    #[must_use]
    pub fn input(&self, channel: Channel) -> &Trace {
        &self.inputs[channel as usize]
    }

    /// Seconds from the first accepted sample to `stamp`.
    #[must_use]
    pub fn seconds(&self, stamp: Stamp) -> f64 {
        stamp.since(self.zero.unwrap_or(stamp)).get()
    }

    /// Length from the first sample to the last estimate, s.
    #[must_use]
    pub fn length_s(&self) -> f64 {
        self.estimates.last().map_or(0.0, |last| self.seconds(last.stamp))
    }

    /// Errors over the whole recording.
    #[must_use]
    pub fn evaluation(&self) -> Evaluation {
        self.evaluator.finish()
    }

    /// A channel as points of a plot.
    #[must_use]
    pub fn points(&self, channel: Channel) -> Vec<(f64, f64)> {
        trace_points(self.input(channel), |stamp| self.seconds(stamp))
    }

    /// The periods between changes of the mode, in order.
    #[must_use]
    pub fn periods(&self) -> Vec<Period> {
        let mut periods = Vec::with_capacity(self.transitions.len());
        for (index, transition) in self.transitions.iter().enumerate() {
            let next = self.transitions.get(index + 1).map(|next| next.stamp);
            let inside = |stamp: Stamp| stamp >= transition.stamp && next.is_none_or(|next| stamp < next);
            let mut period = Period {
                span_s: (
                    self.seconds(transition.stamp),
                    next.map_or(self.length_s(), |next| self.seconds(next)),
                ),
                mode: transition.to,
                cause: transition.cause.text(),
                estimates: 0,
                worst: Validity::Valid,
                reasons: Reasons::NONE,
            };
            for estimate in self.estimates.iter().filter(|e| inside(e.stamp) && e.mode == transition.to) {
                period.estimates += 1;
                period.worst = period.worst.max(estimate.validity);
                period.reasons |= estimate.reasons;
            }
            periods.push(period);
        }
        periods
    }

    /// Error of the published estimates against measured force that was withheld from the service. The points of
    /// `withheld` are times in s and forces in N. `None` without matching estimates.
    #[must_use]
    pub fn fit_to(&self, withheld: &[(f64, f64)]) -> Option<Fit> {
        /// Tolerance for equal times. The stamps of one sample are equal to the nanosecond; times in seconds are rounded.
        const SAME_S: f64 = 1e-6;
        let mut sum = ErrorSum::default();
        let mut estimates = self.estimates.iter().map(|e| (self.seconds(e.stamp), e.force.get())).peekable();
        for (at_s, force_n) in withheld {
            while estimates.next_if(|(stamp_s, _)| *stamp_s < at_s - SAME_S).is_some() {}
            if let Some((_, estimate_n)) = estimates.next_if(|(stamp_s, _)| (stamp_s - at_s).abs() <= SAME_S)
            {
                sum.add(*force_n, estimate_n);
            }
        }
        sum.fit()
    }
}

/// A trace as points of a plot.
pub fn trace_points(trace: &Trace, seconds: impl Fn(Stamp) -> f64) -> Vec<(f64, f64)> {
    trace.stamps.iter().map(|stamp| seconds(*stamp)).zip(trace.values.iter().copied()).collect()
}
