//! Identification of a force law and its dependence on the drive.
//!
//! ```text
//! polynomial   p_j(i) = sum_d c_jd i^d           dF/dc_jd = df/dp_j i^d
//! fuzzy        F = sum_s w_s f(p_s)              dF/dp_sj = w_s df/dp_j
//! ```
//!
//! A law with memory also propagates the derivatives of its hidden variables h (forward sensitivity):
//!
//! ```text
//! F = f(p, h),   h' = g(p, h):    dF/dc = f_p dp/dc + f_h S,    S' = g_p dp/dc + g_h S,    S = dh/dc
//! ```
//!
//! Bounds and starts come from the law's own table of parameters, in the scales of the data. The constant
//! part of a parameter keeps within its bounds; higher powers may move it across the full width of the bounds
//! over the range of the drive.

use super::dataset::Dataset;
use super::free_sets::{Blended, FreeSets};
use super::levels::Memberships;
use super::row_problem::{Columns, Training};
use super::scales::Scales;
use super::search::{self, Found, SearchedModel};
use super::swarm::{self, Swarmed};
use super::tanh_columns::push_weights;
use super::{Options, Watch};
use crate::error::{Error, IdentifyError};
use crate::force::law::{Hidden, Kind, MAX_HIDDEN, MAX_PARAMETERS, Sensitivity};
use crate::force::{Dependence, ForceLaw, FuzzySets, Inputs, LawModel, MAX_FUNCTIONS};
use crate::sample::DriveKind;

/// Share of a gauge parameter's constant that each higher power may add over the range of the drive, so that
/// the sum stays away from zero.
const GAUGE_SHARE: f64 = 0.3;
/// Smallest number of rows per parameter.
const ROWS_PER_PARAMETER: usize = 10;
/// Spread of the sets' starting values around a common value, as a share of the range of starting values.
const SPREAD: f64 = 0.15;

/// Fits `law` with `dependence` to `training`.
pub(super) fn fit(
    training: Training,
    law: ForceLaw,
    dependence: Dependence,
    options: &Options,
    watch: &Watch,
) -> Result<(LawModel, Found), Error> {
    let datasets = training.runs;
    let scales = Scales::of(datasets)?;
    let mut searched = LawColumns::new(law, dependence, scales);
    check_rows(datasets, law, searched.parameters())?;
    if let (Dependence::Fuzzy(sets), true) = (dependence, law.has_memory()) {
        searched.seed = Some(seed(datasets, law, &sets, scales, options, watch)?);
    }
    let found = search::search(training, &searched, options, watch)?;
    let offset_n = super::mean_offset(datasets, &found.offsets_n);
    Ok((LawModel::new(law, dependence, &found.natural, offset_n)?, found))
}

/// A step and a viscous damping that both grow with the drive, in proportion or with a constant part: what is known of every
/// damper. For runs without drive, both are constant.
pub(super) fn fit_growing(
    datasets: &[Dataset],
    drive: Option<DriveKind>,
    options: &Options,
    watch: &Watch,
) -> Result<LawModel, Error> {
    let law = ForceLaw::Sp;
    let dependence = drive.map_or(Dependence::None, |drive| Dependence::Polynomial { drive, degree: 1 });
    let searched = LawColumns { grows: true, ..LawColumns::new(law, dependence, Scales::of(datasets)?) };
    let found = search::search(datasets, &searched, options, watch)?;
    LawModel::new(law, dependence, &found.natural, super::mean_offset(datasets, &found.offsets_n))
}

/// Fits `law` with `dependence` (none, or polynomials) to `datasets` by a particle swarm.
pub(super) fn fit_by_swarm(
    datasets: &[Dataset],
    law: ForceLaw,
    dependence: Dependence,
    options: &Options,
    watch: &Watch,
) -> Result<(LawModel, Found), Error> {
    let searched = LawColumns::new(law, dependence, Scales::of(datasets)?);
    check_rows(datasets, law, searched.parameters())?;
    let found = swarm::search(datasets, &searched, options, watch)?;
    let offset_n = super::mean_offset(datasets, &found.offsets_n);
    Ok((LawModel::new(law, dependence, &found.natural, offset_n)?, found))
}

/// Starting parameters of each of `sets`, from a fit that is linear in the drive. With sets, a law with
/// memory has so many parameters and so costly rows that random restarts fail; the search starts from this
/// seed alone.
fn seed(
    datasets: &[Dataset],
    law: ForceLaw,
    sets: &FuzzySets,
    scales: Scales,
    options: &Options,
    watch: &Watch,
) -> Result<Seed, Error> {
    let dependence = Dependence::Polynomial { drive: sets.drive(), degree: 1 };
    let lines = LawColumns::new(law, dependence, scales);
    let found = search::search(datasets, &lines, options, watch)?;
    let mut seed = [[0.0; MAX_PARAMETERS]; MAX_FUNCTIONS];
    for (own, centre) in seed.iter_mut().zip(sets.centres()) {
        *own = lines.at_drive(&found.natural, &[1.0, *centre]);
    }
    Ok(seed)
}

/// Fits `law` under fuzzy sets with free centres and widths, starting from `start`. The drive takes `levels`
/// discrete values, or `None` if it varies continuously.
pub(super) fn fit_free(
    training: Training,
    law: ForceLaw,
    start: FuzzySets,
    levels: Option<usize>,
    options: &Options,
    watch: &Watch,
) -> Result<(LawModel, Found, Memberships), Error> {
    let datasets = training.runs;
    let inner = LawColumns::new(law, Dependence::Fuzzy(start), Scales::of(datasets)?);
    let searched = FreeSets::new(inner, start, levels)?;
    check_rows(datasets, law, searched.parameters())?;
    let found = search::search(training, &searched, options, watch)?;
    let memberships = searched.found(&found.natural)?;
    let offset_n = super::mean_offset(datasets, &found.offsets_n);
    let dependence = Dependence::Fuzzy(memberships.sets);
    Ok((LawModel::new(law, dependence, searched.own(&found.natural), offset_n)?, found, memberships))
}

/// Refuses runs with too few rows for the number of parameters.
fn check_rows(datasets: &[Dataset], law: ForceLaw, parameters: usize) -> Result<(), Error> {
    let (rows, least) =
        (datasets.iter().map(Dataset::counted).sum::<usize>(), ROWS_PER_PARAMETER * parameters);
    if rows < least {
        return Err(IdentifyError::TooFewSamples {
            model: law.name(),
            which: None,
            samples: rows,
            needed: least,
            count: parameters,
            parts: "parameters",
        }
        .into());
    }
    Ok(())
}

/// Mean of the runs' NMSE after a few restarts on a sample of the rows.
pub(super) fn sample_esr(
    datasets: &[Dataset],
    law: ForceLaw,
    dependence: Dependence,
    seed: u64,
    watch: &Watch,
) -> Result<f64, Error> {
    let searched = LawColumns::new(law, dependence, Scales::of(datasets)?);
    search::sample_esr(datasets, &searched, seed, watch)
}

/// Starting parameters of each set.
type Seed = [[f64; MAX_PARAMETERS]; MAX_FUNCTIONS];

/// A law as the solver needs it.
#[derive(Debug, Clone, Copy)]
pub(super) struct LawColumns {
    law: ForceLaw,
    dependence: Dependence,
    scales: Scales,
    /// The starting point, if it is known.
    seed: Option<Seed>,
    /// True if no linear parameter, nor its change with the drive, is below zero.
    grows: bool,
}

impl LawColumns {
    /// `law` with the bounds of its own table, and random starts.
    const fn new(law: ForceLaw, dependence: Dependence, scales: Scales) -> Self {
        Self { law, dependence, scales, seed: None, grows: false }
    }

    fn per_copy(&self) -> usize {
        self.law.parameters().len()
    }

    /// The law's parameters at a drive value, given its powers in `basis`.
    #[inline]
    fn at_drive(&self, natural: &[f64], basis: &[f64]) -> [f64; MAX_PARAMETERS] {
        let mut p = [0.0; MAX_PARAMETERS];
        for (copy, power) in natural.chunks_exact(self.per_copy()).zip(basis) {
            p.iter_mut().zip(copy).for_each(|(p, c)| *p += c * power);
        }
        p
    }
}

/// Hidden variables of each set, and their derivatives with respect to each coefficient.
pub(super) struct Memory {
    hidden: Vec<Hidden>,
    slopes: Vec<[f64; MAX_HIDDEN]>,
}

/// Advances the derivatives of hidden variables with respect to coefficients (`slopes`) by one sample, and
/// writes the derivatives of the force to `columns`. Each coefficient changes its law parameter by a factor
/// of `power`.
fn carry(found: &Sensitivity, power: f64, slopes: &mut [[f64; MAX_HIDDEN]], columns: &mut [f64]) {
    for (j, (slope, column)) in slopes.iter_mut().zip(columns).enumerate() {
        let through: f64 = found.force_by_hidden.iter().zip(&*slope).map(|(by, s)| by * s).sum();
        *column = found.force_by_parameter[j] * power + through;
        let before = *slope;
        for (h, value) in slope.iter_mut().enumerate() {
            let through: f64 = found.hidden_by_hidden[h].iter().zip(&before).map(|(by, s)| by * s).sum();
            *value = found.hidden_by_parameter[h][j] * power + through;
        }
    }
}

impl Columns for LawColumns {
    type Memory = Memory;

    fn parameters(&self) -> usize {
        self.per_copy() * self.dependence.copies()
    }

    fn has_memory(&self) -> bool {
        self.law.has_memory()
    }

    fn basis_len(&self) -> usize {
        self.dependence.copies()
    }

    fn push_basis(&self, drive: f64, basis: &mut Vec<f64>) {
        match &self.dependence {
            Dependence::None => basis.push(1.0),
            Dependence::Polynomial { degree, .. } => {
                basis.extend((0..=*degree).map(|power| drive.powi(power as i32)));
            }
            Dependence::Fuzzy(sets) => push_weights(sets, drive, basis),
        }
    }

    fn takes(&self, drive: f64) -> bool {
        matches!(self.dependence, Dependence::None) || drive.is_finite()
    }

    fn natural(&self, parameters: &[f64]) -> Vec<f64> {
        parameters.to_vec()
    }

    fn at_rest(&self) -> Memory {
        let sets = if matches!(self.dependence, Dependence::Fuzzy(_)) { self.dependence.copies() } else { 1 };
        let coefficients = if self.has_memory() { self.parameters() } else { 0 };
        Memory { hidden: vec![Hidden::default(); sets], slopes: vec![[0.0; MAX_HIDDEN]; coefficients] }
    }

    #[inline]
    fn row(
        &self,
        memory: &mut Memory,
        inputs: &Inputs,
        basis: &[f64],
        natural: &[f64],
        columns: &mut [f64],
    ) -> f64 {
        if matches!(self.dependence, Dependence::Fuzzy(_)) {
            return self.row_by_set(memory, inputs, basis, natural, columns, &mut [0.0; MAX_FUNCTIONS]);
        }
        let n = self.per_copy();
        let p = self.at_drive(natural, basis);
        if self.has_memory() {
            let found = self.law.sensitivity(&p[..n], inputs, &mut memory.hidden[0]);
            for (copy, power) in basis.iter().enumerate() {
                let own = copy * n..(copy + 1) * n;
                carry(&found, *power, &mut memory.slopes[own.clone()], &mut columns[own]);
            }
            return found.force_n;
        }
        let mut gradient = [0.0; MAX_PARAMETERS];
        let force = self.law.gradient(&p[..n], inputs, &mut gradient[..n]);
        for (columns, power) in columns.chunks_exact_mut(n).zip(basis) {
            columns.iter_mut().zip(&gradient).for_each(|(column, g)| *column = g * power);
        }
        force
    }
}

/// A row of a law under sets, with or without memory. Each set has its own hidden variables, which advance
/// even when the set has no weight, as in the model.
impl Blended for LawColumns {
    #[inline]
    fn row_by_set(
        &self,
        memory: &mut Memory,
        inputs: &Inputs,
        weights: &[f64],
        natural: &[f64],
        columns: &mut [f64],
        forces: &mut [f64],
    ) -> f64 {
        let n = self.per_copy();
        let mut force = 0.0;
        for (set, (&weight, own_force)) in weights.iter().zip(forces).enumerate() {
            let own = set * n..(set + 1) * n;
            let (p, columns) = (&natural[own.clone()], &mut columns[own.clone()]);
            if self.has_memory() {
                let found = self.law.sensitivity(p, inputs, &mut memory.hidden[set]);
                carry(&found, 1.0, &mut memory.slopes[own], columns);
                *own_force = found.force_n;
            } else if weight == 0.0 {
                continue;
            } else {
                *own_force = self.law.gradient(p, inputs, columns);
            }
            if weight == 0.0 {
                columns.fill(0.0);
                continue;
            }
            columns.iter_mut().for_each(|column| *column *= weight);
            force += weight * *own_force;
        }
        force
    }
}

impl SearchedModel for LawColumns {
    fn bounds(&self) -> Vec<[f64; 2]> {
        let mut all = Vec::with_capacity(self.parameters());
        for copy in 0..self.dependence.copies() {
            let constant = copy == 0 || matches!(self.dependence, Dependence::Fuzzy(_));
            for parameter in self.law.parameters() {
                let size = self.scales.size(parameter.scale);
                let middle = 0.5 * (parameter.start[0] + parameter.start[1]);
                let [low, high] = match (constant, parameter.kind) {
                    (true, Kind::Gauge) => [middle, middle],
                    (true, _) => parameter.bounds,
                    (false, _) if !parameter.follows_drive => [0.0, 0.0],
                    (false, Kind::Gauge) => [-GAUGE_SHARE * middle, GAUGE_SHARE * middle],
                    (false, _) => {
                        let width = parameter.bounds[1] - parameter.bounds[0];
                        [-width, width]
                    }
                };
                let low = if self.grows && parameter.kind == Kind::Linear { low.max(0.0) } else { low };
                let power = if constant { 0 } else { copy as i32 };
                let size = size / self.scales.drive.powi(power);
                all.push([low * size, high * size]);
            }
        }
        all
    }

    fn is_linear(&self, j: usize) -> bool {
        self.law.parameters()[j % self.per_copy()].kind == Kind::Linear
    }

    fn draw(&self, restart: u32, uniform: &mut dyn FnMut(f64, f64) -> f64) -> Vec<f64> {
        let n = self.per_copy();
        let mut start = vec![0.0; self.parameters()];
        // Sets of one damper are similar: all are drawn around one point.
        let plain = restart == 0;
        let shares: Vec<f64> = (0..n).map(|_| if plain { 0.5 } else { uniform(0.0, 1.0) }).collect();
        let fuzzy = matches!(self.dependence, Dependence::Fuzzy(_));
        for (copy, values) in start.chunks_exact_mut(n).enumerate() {
            for ((value, parameter), share) in values.iter_mut().zip(self.law.parameters()).zip(&shares) {
                if parameter.kind == Kind::Linear || (copy > 0 && !fuzzy) {
                    continue;
                }
                let spread = if plain || parameter.kind == Kind::Gauge { 0.0 } else { SPREAD };
                let share = (share + if fuzzy { uniform(-spread, spread) } else { 0.0 }).clamp(0.0, 1.0);
                let [low, high] = parameter.start;
                let drawn =
                    if low > 0.0 { low * (high / low).powf(share) } else { low + (high - low) * share };
                *value = drawn * self.scales.size(parameter.scale);
            }
        }
        start
    }

    fn seeded(&self) -> Option<Vec<f64>> {
        let own = |(j, bounds): (usize, [f64; 2])| {
            let value = self.seed.as_ref()?[j / self.per_copy()][j % self.per_copy()];
            Some(value.clamp(bounds[0], bounds[1]))
        };
        self.bounds().into_iter().enumerate().map(own).collect()
    }

    fn settle(&self, _start: &mut [f64]) {}

    fn natural_slopes(&self, parameters: &[f64]) -> Vec<f64> {
        vec![1.0; parameters.len()]
    }
}

impl Swarmed for LawColumns {
    fn start_ranges(&self) -> Vec<[f64; 2]> {
        let n = self.per_copy();
        let one = |(j, bounds): (usize, [f64; 2])| {
            let (copy, parameter) = (j / n, self.law.parameters()[j % n]);
            let size = self.scales.size(parameter.scale);
            let [low, high] = parameter.start;
            let constant = copy == 0 || matches!(self.dependence, Dependence::Fuzzy(_));
            let [low, high] = if constant {
                [low * size, high * size]
            } else {
                let width = (high - low) * size / self.scales.drive.powi(copy as i32);
                [-width, width]
            };
            [low.clamp(bounds[0], bounds[1]), high.clamp(bounds[0], bounds[1])]
        };
        self.bounds().into_iter().enumerate().map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::Membership;
    use crate::force::law::Parameter;
    use crate::sample::DriveKind;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    const SCALES: Scales = Scales {
        force_n: 900.0,
        displacement_m: 0.02,
        velocity_m_s: 0.3,
        acceleration_m_s2: 4.5,
        frequency_1_s: 15.0,
        drive: 2.0,
    };

    fn is_drawn(parameter: &&Parameter) -> bool {
        parameter.kind != Kind::Linear && parameter.start[0] < parameter.start[1]
    }

    /// Positions of drawn parameters within their starting ranges, from 0 to 1, copy after copy.
    fn shares(searched: &LawColumns, restart: u32, random: &mut Pcg64Mcg) -> Vec<f64> {
        let start = searched.draw(restart, &mut |low, high| random.random_range(low..=high));
        let parameters = searched.law.parameters().iter().cycle().zip(start);
        let drawn = parameters.filter(|(parameter, _)| is_drawn(parameter));
        drawn
            .map(|(parameter, value)| {
                let [low, high] = parameter.start;
                let value = value / SCALES.size(parameter.scale);
                if low > 0.0 { (value / low).ln() / (high / low).ln() } else { (value - low) / (high - low) }
            })
            .collect()
    }

    #[test]
    fn starts_fill_each_parameters_range_and_the_first_is_the_middle() {
        let membership = Membership { drive: DriveKind::CoilCurrent, sigma: 0.5 };
        let sets = FuzzySets::new(membership, &[0.0, 1.0, 2.0]).expect("sets");
        let mut random = Pcg64Mcg::seed_from_u64(1);
        for law in ForceLaw::ALL {
            let drawn = law.parameters().iter().filter(is_drawn).count();
            for (dependence, copies) in [(Dependence::None, 1), (Dependence::Fuzzy(sets), sets.len())] {
                let searched = LawColumns::new(law, dependence, SCALES);
                let middle = shares(&searched, 0, &mut random);
                assert_eq!(middle.len(), copies * drawn, "{law:?}");
                assert!(middle.iter().all(|share| (share - 0.5).abs() < 1e-9), "{law:?}: {middle:?}");
                let draws: Vec<_> = (1..200).map(|restart| shares(&searched, restart, &mut random)).collect();
                for parameter in 0..middle.len() {
                    let of = |draw: &Vec<f64>| draw[parameter];
                    let least = draws.iter().map(of).fold(f64::INFINITY, f64::min);
                    let most = draws.iter().map(of).fold(f64::NEG_INFINITY, f64::max);
                    assert!(least > -1e-9 && most < 1.0 + 1e-9, "{law:?}: {least} to {most}");
                    assert!(least < 0.05 && most > 0.95, "{law:?}: {least} to {most}");
                }
                // Sets of one damper are similar.
                let apart = |draw: &Vec<f64>| (draw[0] - draw[draw.len() - drawn]).abs();
                assert!(drawn == 0 || draws.iter().map(apart).fold(0.0, f64::max) < 2.0 * SPREAD + 1e-9);
            }
        }
    }
}
