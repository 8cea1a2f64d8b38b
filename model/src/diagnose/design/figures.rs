//! The figures of a chosen run, and the refusal if it separates nothing.

use super::super::joint::Fitted;
use super::super::round::FINAL;
use super::super::rows::Rows;
use super::super::space::with_effect;
use super::best::{Best, Exact};
use super::criterion::{Squares, at_share};
use super::measured::{RISE_K, dataset};
use super::outcome::{LEAST_SHARE, Z_95};
use super::search::Weighted;
use super::task::{Reported, Rival, Setup, Task};
use super::{
    Design, DesignError, LEAST_IN_PARTS_S, Limits, PARTS, Pair, PlannedSegment, Reached, Separation,
    Settings, plan, road,
};
use crate::error::Error;
use crate::identify::Dataset;
use crate::rig::signal::RATE_HZ;

/// Largest number of pairs that are checked by a true refit: those with the least distance.
const MOST_REFITS: usize = 4;

impl Task<'_> {
    /// The design of the best course, with the road beside it.
    pub(super) fn finish(&self, limits: &Limits, (setup, best): (Setup, Best)) -> Result<Design, Error> {
        let Best { course, .. } = best;
        let reported = setup.reported_pairs(self.question);
        let weighted: Vec<Weighted> = reported
            .iter()
            .map(|pair| Weighted { pair: pair.forms.clone(), weight: 1.0, enough: f64::INFINITY })
            .collect();
        let planned = dataset(&course, &self.model, limits, limits.rate_hz, self.warms, true)?;
        let on_run = self.exact_on(&setup, planned.clone(), &weighted)?.ok_or_else(|| self.diverges())?;
        let on_road = self.exact_on(&setup, setup.road.clone(), &weighted)?.ok_or_else(|| self.diverges())?;
        let mut order: Vec<usize> = (0..reported.len()).collect();
        order.sort_by(|a, b| on_run.squares[*a].apart.total_cmp(&on_run.squares[*b].apart));
        let mut checked = vec![None; reported.len()];
        for &k in order.iter().take(MOST_REFITS) {
            checked[k] = self.refitted(&setup, &planned, &reported[k])?;
        }
        let separation = |exact: &Exact, squares: Squares| {
            Separation::new(squares, exact.rows, exact.seconds, setup.noise_n, limits.duration_s)
        };
        let mut pairs: Vec<Pair> = Vec::new();
        for (k, pair) in reported.iter().enumerate() {
            let mut squares = on_run.squares[k];
            squares.apart = squares.apart.min(checked[k].unwrap_or(f64::INFINITY));
            let own = Pair {
                truth: pair.truth,
                size_is_known: pair.size_is_known,
                rival: pair.rival,
                designed: separation(&on_run, squares),
                is_checked: checked[k].is_some(),
                road: separation(&on_road, on_road.squares[k]),
            };
            pairs.push(own);
        }
        pairs.sort_by(|a, b| a.designed.discrimination.total_cmp(&b.designed.discrimination));
        let unit = self.model.force.drive().map_or("", |kind| kind.unit());
        let seconds = |samples: usize| samples as f64 / limits.rate_hz;
        let segments = course
            .placed
            .iter()
            .map(|placed| {
                let [_, speed_m_s, _] = course.peaks(placed.from, placed.to, limits.rate_hz);
                let part = &course.displacement_m[placed.from..placed.to];
                let (low, high) =
                    part.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
                PlannedSegment {
                    start_s: seconds(placed.from),
                    duration_s: seconds(placed.to - placed.from),
                    what: placed.segment.words([high - low, speed_m_s], limits, unit),
                }
            })
            .collect();
        let [stroke_m, speed_m_s, acceleration_m_s2] =
            course.peaks(0, course.displacement_m.len(), limits.rate_hz);
        let drive = limits.drive.map(|_| {
            let fold = |f: fn(f64, f64) -> f64, start: f64| course.drive.iter().copied().fold(start, f);
            [fold(f64::min, f64::INFINITY), fold(f64::max, f64::NEG_INFINITY)]
        });
        Ok(Design {
            run: course.run("design", limits, self.model.force.drive()),
            road: road::course(limits, self.settings.seed).run(
                "road",
                &Limits { rate_hz: RATE_HZ, ..*limits },
                self.model.force.drive(),
            ),
            pairs,
            segments,
            reached: Reached { stroke_m, speed_m_s, acceleration_m_s2, drive },
            noise_n: setup.noise_n,
            noise_source: setup.noise_source,
            moving_s: on_run.seconds,
            split_s: (limits.duration_s >= LEAST_IN_PARTS_S)
                .then(|| seconds(plan::split_sample(limits, PARTS))),
            assumed_rise_k: self.warms.then_some(RISE_K),
        })
    }

    /// Squared error, N², that is left after the rival of `pair` was fitted to the force with its effect; `None` if the fit fails.
    fn refitted(&self, setup: &Setup, planned: &Dataset, pair: &Reported) -> Result<Option<f64>, Error> {
        let datasets = std::slice::from_ref(planned);
        let rows = Rows::new(datasets, usize::MAX);
        let with = with_effect(&self.without, pair.truth)?;
        let Some(force_n) = rows.predict(&with) else { return Ok(None) };
        let rows = rows.with_force(force_n);
        let joint = self.joint(&rows, setup.scales);
        let effects = setup.effects();
        let mut starts = vec![self.without];
        if !pair.forms.rival.is_empty() {
            starts.clear();
            for form in &pair.forms.rival {
                starts.push(with_effect(&self.without, at_share(&effects[*form], 0.1)?)?);
            }
        }
        let mut least: Option<f64> = None;
        for start in starts {
            if let Some(Fitted { squares, .. }) = joint.refit(&start, FINAL)? {
                least = Some(least.unwrap_or(f64::INFINITY).min(squares));
            }
        }
        Ok(least)
    }

    /// Why no pair is separated, with the change of a limit that helps most.
    pub(super) fn refusal(&self, limits: &Limits, found: &Design, best: &Pair) -> Result<DesignError, Error> {
        let changes: [(&'static str, Limits); 5] = [
            ("allow a faster motion", Limits { speed_m_s: 3.0 * limits.speed_m_s, ..*limits }),
            (
                "allow a higher acceleration",
                Limits { acceleration_m_s2: 4.0 * limits.acceleration_m_s2, ..*limits },
            ),
            ("allow a longer stroke", Limits { stroke_m: 2.0 * limits.stroke_m, ..*limits }),
            (
                "allow a larger drive",
                Limits { drive: limits.drive.map(|[low, high]| [low, high + (high - low)]), ..*limits },
            ),
            ("allow a longer run", Limits { duration_s: (4.0 * limits.duration_s).min(600.0), ..*limits }),
        ];
        let mut helps: Option<(&'static str, f64)> = None;
        for (what, wider) in changes {
            if wider == *limits || wider.check().is_err() {
                continue;
            }
            // The sizes stay as they are, so that only the excitation changes.
            let fixed = Task {
                rivals: self.fixed_rivals(limits)?,
                model: self.model,
                question: self.question,
                without: self.without,
                beside: Vec::new(),
                warms: self.warms,
                settings: &Settings { noise_n: Some(found.noise_n), candidates: 60, ..*self.settings },
                watch: self.watch,
            };
            let design = match fixed.best(&wider).and_then(|best| fixed.finish(&wider, best)) {
                Ok(design) => design,
                Err(Error::Cancelled) => return Err(Error::Cancelled),
                // A wider limit at which the model cannot be simulated does not help.
                Err(_) => continue,
            };
            let Some(pair) = design.pairs.last() else { continue };
            let z = pair.designed.discrimination;
            if z > 1.3 * best.designed.discrimination && helps.is_none_or(|(_, most)| z > most) {
                helps = Some((what, z));
            }
        }
        let effect = best.truth.effect();
        let distance_n = best.designed.distance_n;
        let by_noise_n = distance_n * Z_95 / best.designed.discrimination.max(f64::MIN_POSITIVE);
        let by_share_n = LEAST_SHARE.sqrt() * best.designed.alone_n;
        Ok(DesignError::NotSeparable {
            duration_s: limits.duration_s,
            truth: effect.id(),
            rival: best.rival,
            distance_n,
            needed_n: by_noise_n.max(by_share_n),
            noise_n: found.noise_n,
            noise_source: found.noise_source,
            excitation: effect.separated_by(),
            helps: helps.map(|(what, _)| what),
        })
    }

    /// The rivals with their sizes within `limits`.
    fn fixed_rivals(&self, limits: &Limits) -> Result<Vec<Rival>, Error> {
        let rivals = self.setup(limits)?.rivals;
        Ok(rivals.into_iter().map(|rival| Rival { size_is_known: true, ..rival }).collect())
    }
}
