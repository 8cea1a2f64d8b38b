//! Whether another base would do better without any effect.
//!
//! A base of the wrong structure invites a wrong name: what a damper's elasticity before it yields does to the force looks to
//! a base without hysteresis like a lag, or a spring in series, of quite a physical size. So where much is left to explain, a
//! base with hysteresis of its own, Bouc and Wen's, is identified on the same runs. The base is at fault, and no effect is named,
//! where that rival, without any effect, leaves less of the confirm runs than the base with the best single one of its effects, or
//! than with all of them; or less than half of what the base leaves when there is none to name.

use super::rows::Rows;
use super::sealed;
use crate::error::Error;
use crate::force::{ForceModel, Law};
use crate::identify::{Dataset, Form, ModelSpec, Options, Structure, Watch, identify_datasets};
use crate::model::Model;

/// Restarts of the rival's search.
const RESTARTS: u32 = 4;
/// Degree of its polynomials over the drive, where the levels determine it: with less it is the drive that it cannot follow.
const DEGREE: usize = 4;

/// A base that was tried beside the given one.
pub(super) struct Rival {
    pub(super) name: &'static str,
    /// Squared error on the confirm rows, N².
    pub(super) squares: f64,
}

/// True when `base` has such hysteresis itself.
pub(super) fn is_one(base: &Model) -> bool {
    matches!(&base.force, ForceModel::Law(law) if law.law() == Law::BoucWen)
}

/// The rival of `base`; `None` when none can be identified on these runs.
pub(super) fn rival(
    base: &Model,
    estimate: &[Dataset],
    confirm: &Rows,
    seed: u64,
    watch: &Watch,
) -> Result<Option<Rival>, Error> {
    let form = if base.force.drive().is_some() { Form::SemiActive } else { Form::Passive };
    let spec = ModelSpec::new(Structure::Law(Law::BoucWen), form)?;
    let options = Options {
        conditioning: base.conditioning,
        choose_velocity: false,
        restarts: RESTARTS,
        degree: DEGREE,
        seed,
        ..Options::default()
    };
    match identify_datasets(spec, estimate, &options, watch) {
        Err(Error::Cancelled) => Err(Error::Cancelled),
        // A rival that cannot be found says nothing against the base.
        Err(_) => Ok(None),
        Ok(found) => Ok(sealed::fitted(confirm, &found.model.augmented())
            .ok()
            .map(|fitted| Rival { name: spec.structure().name(), squares: fitted.squares })),
    }
}
