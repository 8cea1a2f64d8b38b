//! The named TSK models: their inputs, and the number and shape of the memberships.
//!
//! Source: `[schurter2000]`, `[atray2003]`, `[ahn2008]`, `[duzhang2006]` and `[wanghu2009]` in the bibliography
//! (node/docs/guide/bibliography.md), section 2.1.4 of the thesis.

use super::{Order, Shape, Signal};
use crate::sample::DriveKind;

/// A TSK model of the thesis or its literature review.
///
/// ```
/// use mr_damper_model::force::{Order, Shape, TskKind};
/// use mr_damper_model::sample::DriveKind;
///
/// let kind = TskKind::from_name("tsk-243").expect("the model of Schurter and Roschke");
/// assert_eq!((kind.shape(), kind.order()), (Shape::Gaussian, Order::First));
/// let rules = |drive| kind.structure(drive).iter().map(|(_, sets)| sets).product::<usize>();
/// assert_eq!((rules(Some(DriveKind::CoilCurrent)), rules(None)), (24, 8)); // 2 * 4 * 3; without drive 2 * 4
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TskKind {
    /// ANFIS (thesis 4.5, appendix C): 3 Gaussians each over displacement, velocity, drive; first order. The
    /// name is also used for any other grid and shape, such as one read from a `.fis` file.
    Anfis,
    /// Schurter and Roschke: 2, 4, 3 Gaussians over displacement, velocity, drive; first order. The review does not
    /// state the shape of their memberships.
    SchurterRoschke,
    /// Atray and Roschke: 3, 2, 4 generalised bells over displacement, velocity, drive; first order. A model with
    /// Gaussians in place of the bells is valid too.
    Atray,
    /// Ahn et al.: 5, 5, 5 triangles over displacement, velocity, drive; constant conclusions. Their triangles move
    /// freely; here they form a partition, in which each foot is the neighbour's peak. They train by back-propagation
    /// alone; here that is a variant ([`crate::identify::Variant::BackPropagation`]).
    Ahn,
    /// Wang and Hu: 3, 3, 3 Gaussians over velocity, acceleration, drive; first order.
    WangHu,
    /// Du and Zhang: the structure of ANFIS, with memberships found by an evolutionary algorithm. Their genetic
    /// algorithm also selects inputs and rules, and the review does not state the structure that it found; here the
    /// structure is fixed. Their algorithm is a variant ([`crate::identify::Variant::Genetic`]) beside differential
    /// evolution.
    Evolved,
}

impl TskKind {
    /// All models.
    pub const ALL: [Self; 6] =
        [Self::Anfis, Self::SchurterRoschke, Self::Atray, Self::Ahn, Self::WangHu, Self::Evolved];

    /// The model's name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Anfis => "anfis",
            Self::SchurterRoschke => "tsk-243",
            Self::Atray => "tsk-324",
            Self::Ahn => "tsk-555",
            Self::WangHu => "tsk-wang-hu",
            Self::Evolved => "tsk-evolved",
        }
    }

    /// The model called `name`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// The inputs with their numbers of memberships. Without a drive it is the passive form, which lacks the
    /// last input.
    #[must_use]
    pub fn structure(self, drive: Option<DriveKind>) -> Vec<(Signal, usize)> {
        let (x, v, a) = (Signal::Displacement, Signal::Velocity, Signal::Acceleration);
        let (motion, drive_sets) = match self {
            Self::Anfis | Self::Evolved => ([(x, 3), (v, 3)], 3),
            Self::SchurterRoschke => ([(x, 2), (v, 4)], 3),
            Self::Atray => ([(x, 3), (v, 2)], 4),
            Self::Ahn => ([(x, 5), (v, 5)], 5),
            Self::WangHu => ([(v, 3), (a, 3)], 3),
        };
        motion.into_iter().chain(drive.map(|kind| (Signal::Drive(kind), drive_sets))).collect()
    }

    /// Shape of the memberships that a fit gives the model.
    #[must_use]
    pub const fn shape(self) -> Shape {
        match self {
            Self::Ahn => Shape::Triangle,
            Self::Atray => Shape::Bell,
            _ => Shape::Gaussian,
        }
    }

    /// True if a model of this kind may have memberships of `shape`: any for ANFIS, and for the others their own.
    /// [`TskKind::Atray`] may also have Gaussians, so that model files with them load.
    #[must_use]
    pub fn allows(self, shape: Shape) -> bool {
        match self {
            Self::Anfis => true,
            Self::Atray => matches!(shape, Shape::Bell | Shape::Gaussian),
            _ => shape == self.shape(),
        }
    }

    /// Order of the conclusions.
    #[must_use]
    pub const fn order(self) -> Order {
        match self {
            Self::Ahn => Order::Constant,
            _ => Order::First,
        }
    }
}
