//! Coulomb friction of seals and guides.
//!
//! ```text
//! F' = F + Fc tanh(v / vs)
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | Fc | `friction_n` | N | friction at any speed |
//! | vs | `sign_velocity_m_s` | m/s | velocity over which the friction changes its sign; 5 mm/s in the form without it |
//! | v | input | m/s | velocity |
//!
//! A scale that is too wide makes Fc too large: on the positioning axis EMPS (published: 20.4 N), by 7 % with 5 mm/s and by 3 % with 1 mm/s.

use super::parts::{SIGN_VELOCITY_M_S, smooth_sign};
use super::{
    Definition, Effect, EffectState, Inside, Inversion, Layer, Parameter, Properties, Refinement, Unit,
    Values,
};
use crate::force::law::Scale;
use crate::force::{Inputs, Number};

const FRICTION: Parameter = Parameter::absolute("friction_n", Unit::NEWTON, [0.0, 200.0], 2.0);

/// Friction that changes its sign over 5 mm/s.
pub(super) struct Friction;

impl Definition for Friction {
    const PROPERTIES: Properties = Properties {
        id: "friction",
        form: None,
        what: "seals and guides add Coulomb friction, the same at any speed and current",
        parameters: &[FRICTION],
        example: &[60.0],
        separated_by: "slow motion without current",
        confounders: &["asymmetry", "deadzone", "velocity_saturation"],
        needs: &[],
        follows_time: false,
        layer: Layer::Parallel(1),
        inversion: Inversion::Subtract,
        static_stiffness_n_m: |_| 0.0,
        refinement: Some(Refinement {
            effect: Effect::FrictionOwnScale,
            values: |[friction_n, ..]| [friction_n, SIGN_VELOCITY_M_S],
        }),
    };

    #[inline]
    fn step<R: Number>(
        [friction_n, ..]: Values<R>,
        _: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        Some(inside.run(inputs)? + friction_n * smooth_sign(inputs.velocity_m_s))
    }
}

/// Friction with its own velocity scale.
pub(super) struct FrictionOwnScale;

impl Definition for FrictionOwnScale {
    const PROPERTIES: Properties = Properties {
        form: Some("own_scale"),
        what: "seals and guides add Coulomb friction, which changes its sign over a velocity of its own",
        parameters: &[
            FRICTION,
            Parameter::shape(
                "sign_velocity_m_s",
                Unit::METRE_PER_SECOND,
                Scale::ONE,
                [2e-4, 50e-3],
                SIGN_VELOCITY_M_S,
            ),
        ],
        example: &[60.0, 2e-3],
        refinement: None,
        ..Friction::PROPERTIES
    };

    #[inline]
    fn step<R: Number>(
        [friction_n, sign_velocity_m_s]: Values<R>,
        _: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        Some(inside.run(inputs)? + friction_n * (inputs.velocity_m_s / sign_velocity_m_s).tanh())
    }
}
