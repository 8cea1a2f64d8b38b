//! Why a model cannot be exported.

/// Why a model cannot be exported.
///
/// ```
/// use mr_damper_export::{CExport, ExportError};
/// use mr_damper_model::preset;
///
/// let model = preset::load(preset::BEST_FUZZY_TANH)?;
/// let error = CExport::new("2nd damper", &model).source().unwrap_err();
/// assert!(matches!(error, ExportError::Name { .. }));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ExportError {
    /// C does not allow the name.
    #[error(
        "'{name}' cannot begin the names in C code: use letters, digits and _, beginning with a letter, at most 40"
    )]
    Name {
        /// The name.
        name: String,
    },
    /// Rounding errors of single precision would be a large part of the model's force.
    #[error(
        "the model {model} has no code in single precision: it solves nearly singular regressions, and tests found forces that were \
         wrong by 16 %. Export it in double precision, or identify another model"
    )]
    Precision {
        /// The model.
        model: &'static str,
    },
    /// Code in single precision has no FMU.
    #[error(
        "an FMU is in double precision, and this code is in single precision: export the model in double precision"
    )]
    FmuPrecision,
    /// A unit has no definition in SI base units, which an FMU needs: a fault of this program.
    #[error("the unit '{symbol}' is not known in SI base units")]
    Unit {
        /// The unit.
        symbol: String,
    },
    /// The archive of an FMU cannot be written.
    #[error("the archive of the FMU: {what}")]
    Archive {
        /// What is wrong.
        what: String,
    },
    /// A fragment of C code is not as it should be: a fault of this program.
    #[error("the fragment {fragment} of C code: {what}")]
    Fragment {
        /// The fragment.
        fragment: String,
        /// What is wrong.
        what: String,
    },
}
