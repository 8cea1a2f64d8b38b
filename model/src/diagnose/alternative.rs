//! Check of an alternative structure: whether another base fits better without any effect.
//!
//! A base of the wrong structure leads to a wrong name. The elasticity of a damper before it yields, for example, looks to a base
//! without hysteresis like a lag, or a spring in series, of a physically plausible size. If the lack of fit stays above 0.5, the
//! Bouc-Wen model, which has hysteresis, is therefore identified on the same runs. The base is inadequate, and no effect is named,
//! if on the validation runs the alternative without any effect has less squared error than the base with its best single effect or
//! than the base with all its effects. If no effect was found, the base is inadequate if the alternative removes more than half of
//! its reducible error.

use super::rows::Rows;
use super::test_runs;
use crate::error::Error;
use crate::force::{ForceLaw, ForceModel};
use crate::identify::{Dataset, Form, ModelSpec, Options, Structure, Watch, identify_datasets};
use crate::model::Model;

/// Restarts of the search for the alternative's coefficients.
const RESTARTS: u32 = 4;
/// Degree of its polynomials over the drive, if the drive levels determine it. With a lower degree it could not follow the drive.
const DEGREE: usize = 4;

/// An alternative to the given base.
pub(super) struct Alternative {
    pub(super) name: &'static str,
    /// Squared error on the validation rows, N².
    pub(super) squares: f64,
}

/// True if `base` already has the alternative structure.
pub(super) fn is_one(base: &Model) -> bool {
    matches!(&base.force, ForceModel::Law(law) if law.law() == ForceLaw::BoucWen)
}

/// The alternative to `base`; `None` if it cannot be identified on these runs.
pub(super) fn identify(
    base: &Model,
    estimate: &[Dataset],
    confirm: &Rows,
    seed: u64,
    watch: &Watch,
) -> Result<Option<Alternative>, Error> {
    let form = if base.force.drive().is_some() { Form::SemiActive } else { Form::Passive };
    let spec = ModelSpec::new(Structure::Law(ForceLaw::BoucWen), form)?;
    let options = Options {
        conditioning: base.conditioning,
        choose_velocity: false,
        restarts: RESTARTS,
        degree: DEGREE,
        seed,
        ..Options::default()
    };
    match identify_datasets(spec, estimate, &options, watch) {
        // If the runs do not determine the alternative, it is not evidence against the base.
        Err(Error::Identify(_)) => Ok(None),
        Err(error) => Err(error),
        Ok(found) => Ok(test_runs::fitted(confirm, &found.model.augmented())
            .ok()
            .map(|fitted| Alternative { name: spec.structure().name(), squares: fitted.squares })),
    }
}
