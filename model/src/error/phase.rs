//! Why a phase-transition relation cannot run as a model.

use serde::Serialize;

/// A root of the relation's characteristic equation near rest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Root {
    /// Real part, 1/s; positive for a growing solution.
    pub re_per_s: f64,
    /// Imaginary part, rad/s.
    pub im_rad_s: f64,
}

/// Why the relation cannot be integrated forward to predict force.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CannotRun {
    /// Roots near rest at constant velocity; fewer than two if p3 is zero, none if p2 is zero as well.
    pub roots: [Option<Root>; 2],
    /// Smallest force at which the static velocity turns back, N; `None` if it rises throughout.
    pub folds_at_n: Option<f64>,
}

impl CannotRun {
    /// True if a root does not lie in the left half plane.
    #[must_use]
    pub fn is_unstable(&self) -> bool {
        self.roots.iter().flatten().any(|root| root.re_per_s >= 0.0)
    }
}

impl std::fmt::Display for CannotRun {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let growing = self.roots.iter().flatten().filter(|root| root.re_per_s >= 0.0);
        let fastest = growing.max_by(|a, b| a.re_per_s.total_cmp(&b.re_per_s));
        if let Some(root) = fastest {
            write!(
                f,
                "integrated forward it diverges: near rest it has a root at {:.1} ± {:.1}i 1/s",
                root.re_per_s,
                root.im_rad_s.abs()
            )?;
        }
        if let Some(force_n) = self.folds_at_n {
            let joint = if fastest.is_some() { "; " } else { "" };
            write!(
                f,
                "{joint}its static velocity folds back at {force_n:.0} N, so that one velocity has three forces"
            )?;
        }
        Ok(())
    }
}
