//! What a design is asked: the model without the rivals, their sizes, and the noise.

use super::super::joint::Joint;
use super::super::ranges::Ranges;
use super::super::rows::{Rows, dot};
use super::super::space::{Space, with_effect};
use super::criterion::PairOfForms;
use super::measured::{dataset, with_simulated_force};
use super::{DesignError, Limits, NoiseSource, Question, Settings, road};
use crate::effect::{Augmented, Effect, EffectModel, Effects, MAX_EFFECTS, Need};
use crate::error::Error;
use crate::force::ForceLaw;
use crate::identify::{Dataset, Scales, Watch};
use crate::model::Model;
use crate::rig::signal::RATE_HZ;

/// Change of the force by an effect whose size is not known, on the road, as a share of the force (root mean squares). If a rival's size is
/// known, the others change the force as much as it does.
const TYPICAL: f64 = 0.05;
/// Number of steps to that size.
const SIZING: usize = 5;
/// Largest change of the force by an effect, as a share of the force. A form that changes it by more diverges, and is left out.
const MOST_OF_FORCE: f64 = 10.0;
/// Noise as a share of the force on the road, if it is not known.
const NOISE_SHARE: f64 = 0.01;

/// Forms of an effect, with their sizes.
#[derive(Debug, Clone)]
pub(super) struct Rival {
    pub(super) id: &'static str,
    pub(super) forms: Vec<EffectModel>,
    pub(super) size_is_known: bool,
}

/// Everything that does not depend on the limits.
pub(super) struct Task<'a> {
    pub(super) model: Model,
    pub(super) question: &'a Question,
    /// The model without the rivals.
    pub(super) without: Augmented,
    pub(super) rivals: Vec<Rival>,
    /// Effects that are not rivals; a rival should not look like them either.
    pub(super) beside: Vec<Effect>,
    pub(super) warms: bool,
    pub(super) settings: &'a Settings,
    pub(super) watch: &'a Watch<'a>,
}

/// The sizes and scales within some limits.
pub(super) struct Setup {
    pub(super) scales: Scales,
    pub(super) rivals: Vec<Rival>,
    pub(super) beside: Vec<EffectModel>,
    pub(super) noise_n: f64,
    pub(super) noise_source: NoiseSource,
    pub(super) road: Dataset,
}

impl<'a> Task<'a> {
    pub(super) fn new(
        model: &Model,
        question: &'a Question,
        limits: &Limits,
        settings: &'a Settings,
        watch: &'a Watch<'a>,
    ) -> Result<Self, Error> {
        limits.check()?;
        if let Some(noise_n) = settings.noise_n {
            Error::check("noise_n", noise_n, "positive and finite", |n| n > 0.0)?;
        }
        Error::check("candidates", settings.candidates as f64, "10 to 2000", |n| {
            (10.0..=2000.0).contains(&n)
        })?;
        let name = model.force.name();
        match (model.force.drive(), limits.drive) {
            (Some(kind), None) => {
                return Err(DesignError::DriveNeeded {
                    model: name,
                    drive: kind.in_words(),
                    unit: kind.unit(),
                }
                .into());
            }
            (None, Some(_)) => return Err(DesignError::DriveNotUsed { model: name }.into()),
            _ => {}
        }
        let ids = question.ids();
        let is_rival = |effect: Effect| ids.contains(&effect.id());
        let has = model.effects.as_slice();
        let kept: Vec<EffectModel> = has.iter().filter(|e| !is_rival(e.effect())).copied().collect();
        if kept.len() >= MAX_EFFECTS {
            return Err(DesignError::TooManyEffects { found: kept.len() }.into());
        }
        let without = Augmented::new(model.force, Effects::new(&kept)?.with_terms(*model.effects.terms()))?;
        // A base whose coefficients cannot be refitted is refused before any work.
        let unit = Scales {
            force_n: 1.0,
            displacement_m: 1.0,
            velocity_m_s: 1.0,
            acceleration_m_s2: 1.0,
            frequency_1_s: 1.0,
            drive: 1.0,
        };
        Space::new(&without, unit, Ranges::default(), true).map_err(|_| DesignError::Base {
            model: name,
            laws: ForceLaw::ALL.map(ForceLaw::name).to_vec(),
        })?;
        let drives = limits.drive.is_some();
        let forms = |id: &'static str| -> Result<Rival, Error> {
            let known: Vec<EffectModel> = has.iter().filter(|e| e.effect().id() == id).copied().collect();
            let size_is_known = !known.is_empty();
            let plain = Effect::ALL.into_iter().filter(|effect| effect.id() == id && !is_refinement(*effect));
            if plain.clone().any(|effect| effect.needs().contains(&Need::Drive)) && !drives {
                return Err(DesignError::NoDrive { effect: id, model: name }.into());
            }
            let forms =
                if size_is_known { known } else { plain.map(|effect| effect.probe(0, |_| 1.0)).collect() };
            Ok(Rival { id, forms, size_is_known })
        };
        let rivals: Vec<Rival> = ids.iter().map(|id| forms(id)).collect::<Result<_, _>>()?;
        let needs_case = |effect: Effect| effect.needs().contains(&Need::CaseTemperature);
        let warms = without.effects().need(Need::CaseTemperature)
            || rivals.iter().flat_map(|rival| &rival.forms).any(|form| needs_case(form.effect()));
        let beside = Effect::ALL
            .into_iter()
            .filter(|effect| !is_rival(*effect) && !is_refinement(*effect))
            .filter(|effect| !kept.iter().any(|other| other.effect().id() == effect.id()))
            .filter(|effect| drives || !effect.needs().contains(&Need::Drive))
            .filter(|effect| !needs_case(*effect) && !effect.follows_time())
            .collect();
        Ok(Self { model: *model, question, without, rivals, beside, warms, settings, watch })
    }

    pub(super) fn diverges(&self) -> Error {
        DesignError::Diverges { model: self.model.force.name() }.into()
    }

    /// Scales, sizes and noise within `limits`, from the road.
    pub(super) fn setup(&self, limits: &Limits) -> Result<Setup, Error> {
        let course = road::course(limits, self.settings.seed);
        let road = dataset(&course, &self.model, limits, RATE_HZ, self.warms, true)?;
        let road = with_simulated_force(road, &self.without).ok_or_else(|| self.diverges())?;
        let datasets = [road];
        let scales = Scales::of(&datasets)?;
        let rows = Rows::new(&datasets, usize::MAX);
        let here_n = rows.predict(&self.without).ok_or_else(|| self.diverges())?;
        let rms = |series: &[f64]| (dot(series, series) / series.len().max(1) as f64).sqrt();
        let mut force_n = here_n.clone();
        rows.centre(&mut force_n);
        let force_n = rms(&force_n);
        // Rivals imitate an effect whose size is known at this size.
        let mut known_n = Vec::new();
        for form in self.rivals.iter().filter(|rival| rival.size_is_known).flat_map(|rival| &rival.forms) {
            if let Some(mut change) = rows.difference(&with_effect(&self.without, *form)?, &here_n, 1.0) {
                rows.centre(&mut change);
                known_n.push(rms(&change));
            }
        }
        let largest_n = known_n.into_iter().fold(0.0_f64, f64::max);
        let wanted_n = if largest_n > 0.0 { largest_n } else { TYPICAL * force_n };
        let sized = |effect: Effect| -> Result<Option<EffectModel>, Error> {
            let parameter = &effect.parameters()[0];
            let size = scales.size(parameter.scale);
            let neutral = parameter.neutral * size;
            let [low, high] = Ranges::default().of(effect, 0, parameter, size);
            let mut values: Vec<f64> = effect.probe(0, |scale| scales.size(scale)).parameters().to_vec();
            let change_at = |values: &[f64]| -> Result<Option<f64>, Error> {
                let there = with_effect(&self.without, EffectModel::new(effect, values)?)?;
                let Some(mut change) = rows.difference(&there, &here_n, 1.0) else { return Ok(None) };
                rows.centre(&mut change);
                Ok(Some(rms(&change)))
            };
            for _ in 0..SIZING {
                let Some(change_n) = change_at(&values)? else { break };
                // An effect that the road does not show grows to the end of its range.
                let factor = if change_n > 0.0 { (wanted_n / change_n).clamp(0.1, 20.0) } else { 20.0 };
                values[0] = (neutral + factor * (values[0] - neutral)).clamp(low, high);
            }
            let diverges = change_at(&values)?.is_none_or(|change_n| change_n > MOST_OF_FORCE * force_n);
            Ok(if diverges { None } else { Some(EffectModel::new(effect, &values)?) })
        };
        let rivals = self
            .rivals
            .iter()
            .map(|rival| {
                if rival.size_is_known {
                    return Ok(rival.clone());
                }
                let sized =
                    rival.forms.iter().map(|form| sized(form.effect())).collect::<Result<Vec<_>, _>>()?;
                let forms: Vec<EffectModel> = sized.into_iter().flatten().collect();
                if forms.is_empty() {
                    return Err(self.diverges());
                }
                Ok(Rival { forms, ..rival.clone() })
            })
            .collect::<Result<_, Error>>()?;
        let beside = self.beside.iter().map(|effect| sized(*effect)).collect::<Result<Vec<_>, _>>()?;
        let beside = beside.into_iter().flatten().collect();
        let (noise_n, noise_source) = match (self.settings.noise_n, self.model.expected.free_run_rsse_n) {
            (Some(given), _) => (given, NoiseSource::Given),
            (None, Some(known)) if known > 0.0 => (known, NoiseSource::Model),
            _ => (NOISE_SHARE * force_n, NoiseSource::Assumed),
        };
        let [road] = datasets;
        Ok(Setup { scales, rivals, beside, noise_n, noise_source, road })
    }

    pub(super) fn joint<'b>(&'b self, rows: &'b Rows<'b>, scales: Scales) -> Joint<'b> {
        Joint { rows, scales, ranges: Ranges::default(), base_moves: true, watch: self.watch }
    }
}

/// A pair of the result.
pub(super) struct Reported {
    pub(super) truth: EffectModel,
    pub(super) size_is_known: bool,
    pub(super) rival: Option<&'static str>,
    pub(super) forms: PairOfForms,
}

impl Setup {
    /// The forms of the rivals, then the effects beside them: the order of the columns.
    pub(super) fn effects(&self) -> Vec<EffectModel> {
        self.rivals.iter().flat_map(|rival| &rival.forms).chain(&self.beside).copied().collect()
    }

    /// For each rival the numbers of its forms.
    fn numbers(&self) -> Vec<Vec<usize>> {
        let mut next = 0;
        let numbers = |rival: &Rival| {
            let own = (next..next + rival.forms.len()).collect();
            next += rival.forms.len();
            own
        };
        self.rivals.iter().map(numbers).collect()
    }

    /// The pairs of the result: each form of each effect against each of its rivals.
    pub(super) fn reported_pairs(&self, question: &Question) -> Vec<Reported> {
        let numbers = self.numbers();
        let mut pairs = Vec::new();
        for (own, rival) in numbers.iter().zip(&self.rivals) {
            for (form, truth) in own.iter().zip(&rival.forms) {
                for other in question.rivals(rival.id) {
                    let forms = numbers.iter().zip(&self.rivals).find(|(_, known)| Some(known.id) == other);
                    pairs.push(Reported {
                        truth: *truth,
                        size_is_known: rival.size_is_known,
                        rival: other,
                        forms: PairOfForms {
                            truth: *form,
                            rival: forms.map(|(forms, _)| forms.clone()).unwrap_or_default(),
                        },
                    });
                }
            }
        }
        pairs
    }
}

/// True for a form that a diagnosis tries only after its plain form was named.
fn is_refinement(effect: Effect) -> bool {
    Effect::ALL.iter().any(|other| other.refined() == Some(effect))
}
