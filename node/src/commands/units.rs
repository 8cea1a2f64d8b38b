//! The unit of forces on the terminal.

use clap::ValueEnum;
use mr_damper_model::units::N_PER_LBF;

/// Unit of forces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum Units {
    /// Newtons.
    #[default]
    #[value(name = "N", alias = "n")]
    N,
    /// Pounds-force.
    Lbf,
}

/// The option `--units`.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct UnitsArgs {
    /// Unit of forces in the printed tables. JSON and model files always hold newtons.
    #[arg(long, value_enum, default_value_t)]
    pub units: Units,
}

impl Units {
    /// A force of `newtons` in this unit.
    #[must_use]
    pub fn of_n(self, newtons: f64) -> f64 {
        match self {
            Self::N => newtons,
            Self::Lbf => newtons / N_PER_LBF,
        }
    }

    /// Symbol of the unit.
    #[must_use]
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::N => "N",
            Self::Lbf => "lbf",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pound_is_the_weight_of_the_avoirdupois_pound() {
        // 0.45359237 kg times 9.80665 m/s².
        assert!((Units::Lbf.of_n(0.453_592_37 * 9.806_65) - 1.0).abs() < 1e-7);
        assert_eq!(Units::N.of_n(7.0), 7.0);
    }
}
