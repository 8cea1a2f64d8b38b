//! Effects that can be injected into the rig, with the ids that the diagnosis uses for them.
//!
//! Each effect is one declaration in [`EFFECTS`]. It sets one property of the plant or the measurement chain, or adds a force to the rod's.
//! Size 0 removes it, also the coil lag and the thermal fade of the default plant. Where there is a choice, the form differs from the form
//! that the diagnosis tries. Asymmetry and position act on the valve, not on the force; a dead zone is play before the compliance; the
//! low-pass of the load cell is of second order.

use super::channel::Channels;
use super::plant::{Plant, PlantState, ValveForm};
use super::second_order::SecondOrder;
use super::undeclared;
use crate::error::{Error, RigError};

/// An effect that can be injected.
#[derive(Debug, Clone, Copy)]
pub struct Effect {
    /// Id of the effect.
    pub id: &'static str,
    /// Unit of its size.
    pub unit: &'static str,
    /// Least and largest size, in that unit.
    pub range: (f64, f64),
    /// A size that clearly changes the force, in that unit.
    pub typical: f64,
    /// Description in one line.
    pub what: &'static str,
    entry: Entry,
}

/// How an effect of a given size enters the rig. An effect whose force is an explicit function of the present state needs nothing outside
/// its declaration ([`Entry::RodForce`]); for any other effect, the equations of plant or channels have the property that it sets.
#[derive(Debug, Clone, Copy)]
enum Entry {
    /// Sets properties of the plant.
    Plant(fn(&mut Plant, f64)),
    /// Sets properties of the measurement chain.
    Channels(fn(&mut Channels, f64)),
    /// Adds a force to the rod force, with the arguments of [`AddedForces::at`] after the size. Size 0 adds none.
    RodForce(fn(f64, &PlantState, f64, f64) -> f64),
}

/// Greatest number of effects.
const MOST_EFFECTS: usize = 40;

const _: () = assert!(EFFECTS.len() <= MOST_EFFECTS);

/// Forces that injected effects add to the rod force. By default there are none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AddedForces {
    /// Sizes of the effects, in the order of [`EFFECTS`]; 0 without the effect.
    sizes: [f64; MOST_EFFECTS],
}

impl Default for AddedForces {
    fn default() -> Self {
        Self { sizes: [0.0; MOST_EFFECTS] }
    }
}

impl AddedForces {
    /// Their sum in newtons at `state`, displacement `x_m` and velocity `v_m_s`.
    pub(super) fn at(&self, state: &PlantState, x_m: f64, v_m_s: f64) -> f64 {
        EFFECTS.iter().zip(self.sizes).fold(0.0, |sum, (effect, size)| match effect.entry {
            Entry::RodForce(force_n) if size != 0.0 => sum + force_n(size, state, x_m, v_m_s),
            Entry::RodForce(_) | Entry::Plant(_) | Entry::Channels(_) => sum,
        })
    }
}

/// Ratio of the force at rest to the stiffness of a gas spring, in metres: 500 N for 20 kN/m.
const GAS_STROKE_M: f64 = 0.025;

/// All effects: first the effects of the effect library in its order, then effects that only the rig has. The library does not contain
/// `position_ripple` and the effects after it, so a correct diagnosis does not name an effect for them. The equations of those from
/// `seal_drag` on are in [`super::undeclared`].
pub const EFFECTS: &[Effect] = &[
    Effect {
        id: "coil_lag",
        unit: "s",
        range: (0.0, 0.1),
        typical: 0.012,
        what: "lag of the coil, for rise and fall (default plant: 0.012)",
        entry: Entry::Plant(|plant, size| (plant.coil_rise_s, plant.coil_fall_s) = (size, size)),
    },
    Effect {
        id: "remanence",
        unit: "A",
        range: (0.0, 1.0),
        typical: 0.15,
        what: "play of the core's magnetisation, to either side",
        entry: Entry::Plant(|plant, size| plant.remanence_a = size),
    },
    Effect {
        id: "thermal_fade",
        unit: "1/K",
        range: (-0.02, 0.02),
        typical: -0.004,
        what: "change of yield force and damping with temperature (default plant: -0.002)",
        entry: Entry::Plant(|plant, size| (plant.yield_fade_per_k, plant.viscous_fade_per_k) = (size, size)),
    },
    Effect {
        id: "gas_spring",
        unit: "N/m",
        range: (0.0, 5e4),
        typical: 6e3,
        what: "stiffness of the gas, which pushes the rod out at rest with 0.025 m times that",
        entry: Entry::Plant(|plant, size| {
            (plant.gas_stiffness_n_m, plant.gas_force_n) = (size, GAS_STROKE_M * size);
        }),
    },
    Effect {
        id: "inertia",
        unit: "kg",
        range: (0.0, 20.0),
        typical: 2.5,
        what: "mass that moves with the load cell",
        entry: Entry::Plant(|plant, size| plant.mass_kg = size),
    },
    Effect {
        id: "friction",
        unit: "N",
        range: (0.0, 1000.0),
        typical: 80.0,
        what: "Coulomb friction of the seals",
        entry: Entry::Plant(|plant, size| plant.friction_n = size),
    },
    Effect {
        id: "asymmetry",
        unit: "-",
        range: (-0.4, 0.4),
        typical: 0.15,
        what: "share by which the valve is stiffer in extension, and softer in compression",
        entry: Entry::Plant(|plant, size| plant.asymmetry = size),
    },
    Effect {
        id: "force_lag",
        unit: "s",
        range: (0.0, 0.1),
        typical: 3e-3,
        what: "first-order lag of the rod force",
        entry: Entry::Plant(|plant, size| plant.force_lag_s = size),
    },
    Effect {
        id: "sensor_delay",
        unit: "s",
        range: (-0.1, 0.1),
        typical: 3e-3,
        what: "time by which the force channel is late; negative for early",
        entry: Entry::Channels(|channels, size| channels.force_delay_s = size),
    },
    Effect {
        id: "deadzone",
        unit: "m",
        range: (0.0, 0.01),
        typical: 3e-4,
        what: "free play between rod and valve",
        entry: Entry::Plant(|plant, size| plant.free_play_m = size),
    },
    Effect {
        id: "end_stop",
        unit: "m",
        range: (0.0, 0.1),
        typical: 0.014,
        what: "displacement beyond which end stops of 200 kN/m push back; 0 for none",
        entry: Entry::Plant(|plant, size| plant.end_stop_m = if size > 0.0 { size } else { f64::INFINITY }),
    },
    Effect {
        id: "load_cell_drift",
        unit: "N/s",
        range: (-10.0, 10.0),
        typical: 0.2,
        what: "drift of the load cell",
        entry: Entry::Channels(|channels, size| channels.force_drift_n_s = size),
    },
    Effect {
        id: "position_dependence",
        unit: "1/m",
        range: (-20.0, 20.0),
        typical: 5.0,
        what: "growth of the valve's force with displacement",
        entry: Entry::Plant(|plant, size| plant.position_per_m = size),
    },
    Effect {
        id: "velocity_saturation",
        unit: "N s2/m2",
        range: (-2000.0, 2e4),
        typical: 3000.0,
        what: "added force proportional to v |v|",
        entry: Entry::RodForce(|size, _, _, v| size * v * v.abs()),
    },
    Effect {
        id: "anti_alias_mismatch",
        unit: "s",
        range: (0.0, 0.1),
        typical: 3e-3,
        what: "delay of the force channel's own low-pass (second order)",
        entry: Entry::Channels(|channels, size| {
            channels.force_filter = (size > 0.0).then(|| SecondOrder::with_delay_s(size));
        }),
    },
    Effect {
        id: "fluid_lag",
        unit: "s",
        range: (0.0, 0.1),
        typical: 0.01,
        what: "lag of the fluid behind the core, beyond the coil's",
        entry: Entry::Plant(|plant, size| plant.fluid_lag_s = size),
    },
    Effect {
        id: "series_spring",
        unit: "m/N",
        range: (0.0, 1e-5),
        typical: 2e-7,
        what: "compliance in series with the valve (default plant and minimum: 1.7e-7)",
        entry: Entry::Plant(|plant, size| {
            let stiffest = match plant.valve_form {
                ValveForm::BoucWen | ValveForm::Bristle(_) => Plant::default().series_stiffness_n_m,
                ValveForm::QuasiStatic(_) => f64::INFINITY,
            };
            plant.series_stiffness_n_m = stiffest.min(1.0 / size);
        }),
    },
    Effect {
        id: "warm_start",
        unit: "K",
        range: (-40.0, 80.0),
        typical: 20.0,
        what: "temperature of the damper at the start, above room temperature",
        entry: Entry::Plant(|plant, size| plant.start_c = plant.ambient_c + size),
    },
    Effect {
        id: "position_ripple",
        unit: "-",
        range: (0.0, 0.4),
        typical: 0.15,
        what: "ripple of the valve's force over displacement, as a share of it, with a period of 5 mm",
        entry: Entry::Plant(|plant, size| plant.position_ripple = size),
    },
    Effect {
        id: "force_loss",
        unit: "-",
        range: (0.0, 0.9),
        typical: 0.15,
        what: "share of the force that is lost from the middle of the run on",
        entry: Entry::Plant(|plant, size| plant.force_loss = size),
    },
    Effect {
        id: "mains_hum",
        unit: "N",
        range: (0.0, 500.0),
        typical: 30.0,
        what: "amplitude of 50 Hz mains hum in the force channel",
        entry: Entry::Channels(|channels, size| channels.force_hum_n = size),
    },
    Effect {
        id: "wear_step",
        unit: "-",
        range: (0.0, 0.9),
        typical: 0.25,
        what: "share of the yield force lost by wear from a third of the run on",
        entry: Entry::Plant(|plant, size| plant.wear = size),
    },
    Effect {
        id: "seal_drag",
        unit: "N",
        range: (0.0, 500.0),
        typical: 40.0,
        what: "drag of the rod seal at 0.1 m/s; it grows with the velocity to the power of 0.4",
        entry: Entry::RodForce(undeclared::seal_drag_n),
    },
    Effect {
        id: "stray_field",
        unit: "N/A2",
        range: (-200.0, 200.0),
        typical: 10.0,
        what: "pull of the coil's stray field on the load cell, proportional to the square of the current",
        entry: Entry::RodForce(undeclared::stray_field_n),
    },
    Effect {
        id: "mount_resonance",
        unit: "-",
        range: (0.0, 1.0),
        typical: 0.5,
        what: "share of the force that passes through a resonance of the mount at 32 Hz",
        entry: Entry::Plant(|plant, size| plant.undeclared.mount_resonance = size),
    },
    Effect {
        id: "bore_score",
        unit: "-",
        range: (0.0, 0.4),
        typical: 0.2,
        what: "share of the valve's force lost at a score of the cylinder, 2 mm to either side of 3 mm",
        entry: Entry::Plant(|plant, size| plant.undeclared.bore_score = size),
    },
    Effect {
        id: "thixotropy",
        unit: "-",
        range: (0.0, 0.9),
        typical: 0.7,
        what: "share by which the yield force grows at rest; it builds in 0.3 s and breaks over 5 mm",
        entry: Entry::Plant(|plant, size| plant.undeclared.thixotropy = size),
    },
    Effect {
        id: "wall_slip",
        unit: "-",
        range: (0.0, 0.9),
        typical: 0.3,
        what: "share of the yield force lost where velocity times current is above 0.08 A m/s",
        entry: Entry::Plant(|plant, size| plant.undeclared.wall_slip = size),
    },
    Effect {
        id: "aeration",
        unit: "-",
        range: (0.0, 0.9),
        typical: 0.15,
        what: "share of the valve's force lost after fast strokes; the gas separates in 1.5 s",
        entry: Entry::Plant(|plant, size| plant.undeclared.aeration = size),
    },
    Effect {
        id: "cavitation",
        unit: "-",
        range: (0.0, 0.9),
        typical: 0.1,
        what: "share of the extension stroke above 300 N that the next compression makes with little force",
        entry: Entry::Plant(|plant, size| plant.undeclared.cavitation = size),
    },
    Effect {
        id: "seal_blowout",
        unit: "-",
        range: (0.0, 0.9),
        typical: 0.15,
        what: "share of the valve's compression force lost after the rod has travelled 0.5 m",
        entry: Entry::Plant(|plant, size| plant.undeclared.seal_blowout = size),
    },
    Effect {
        id: "relief_valve",
        unit: "-",
        range: (0.0, 0.9),
        typical: 0.3,
        what: "share of the valve's force above 500 N that a relief valve removes",
        entry: Entry::Plant(|plant, size| plant.undeclared.relief_valve = size),
    },
    Effect {
        id: "core_saturation",
        unit: "1/A",
        range: (0.0, 5.0),
        typical: 0.5,
        what: "reciprocal of the current at which the core saturates",
        entry: Entry::Plant(|plant, size| plant.undeclared.core_saturation_per_a = size),
    },
    Effect {
        id: "current_sensor_creep",
        unit: "-",
        range: (0.0, 1.0),
        typical: 0.2,
        what: "growth of the current sensor's gain until its auto-zero every 7 s; the coil has less current",
        entry: Entry::Plant(|plant, size| plant.undeclared.current_sensor_creep = size),
    },
];

/// Injects the effect called `id` into plant and channels, with `size` in its unit.
///
/// ```
/// use mr_damper_model::rig::inject::{AddedForces, inject};
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
///
/// let force_n = |plant: &Plant, channels: &Channels| {
///     record(&Experiment::sine(0.01, 2.0, 1.2, 2.0), plant, channels, 1).force_n.expect("the rig has a load cell").values
/// };
/// let (mut plant, mut channels) = (Plant::default(), Channels::PERFECT);
/// let healthy_n = force_n(&plant, &channels);
/// inject("friction", 80.0, &mut plant, &mut channels)?;
/// let change_n = force_n(&plant, &channels).iter().zip(&healthy_n).map(|(with, without)| with - without).fold(0.0, f64::max);
/// assert!((change_n - 80.0).abs() < 8.0, "{change_n} N");
///
/// // Some effects are forces that are added to the damper's.
/// inject("velocity_saturation", 3000.0, &mut plant, &mut channels)?;
/// assert_ne!(plant.added_forces, AddedForces::default());
///
/// let error = inject("friction", -5.0, &mut plant, &mut channels).unwrap_err().to_string();
/// assert!(error.contains("friction") && error.contains("1000"), "{error}");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
///
/// # Errors
/// [`RigError::UnknownInjection`]; [`RigError::InjectionSize`]; [`Error::OutOfRange`] if the plant cannot
/// be integrated with it.
pub fn inject(id: &str, size: f64, plant: &mut Plant, channels: &mut Channels) -> Result<(), Error> {
    let Some((place, effect)) = EFFECTS.iter().enumerate().find(|(_, effect)| effect.id == id) else {
        let known: Vec<&str> = EFFECTS.iter().map(|effect| effect.id).collect();
        return Err(RigError::UnknownInjection { id: id.to_owned(), known }.into());
    };
    let (low, high) = effect.range;
    if !(low..=high).contains(&size) {
        let (id, unit) = (effect.id, effect.unit);
        return Err(RigError::InjectionSize { id, size, unit, range: [low, high] }.into());
    }
    match effect.entry {
        Entry::Plant(set) => set(plant, size),
        Entry::Channels(set) => set(channels, size),
        Entry::RodForce(_) => plant.added_forces.sizes[place] = size,
    }
    plant.check()?;
    channels.check()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::{Experiment, record};

    fn force(plant: &Plant, channels: &Channels) -> Vec<f64> {
        let run = Experiment::thesis("RP3-CS")
            .map(|e| record(&e.with_duration_s(14.0), plant, channels, 1))
            .unwrap_or_default();
        run.force_n.map(|trace| trace.values).unwrap_or_default()
    }

    /// Plants with both valves, without any effect.
    fn plants() -> [Plant; 2] {
        [Plant::plain(), Plant::quasi_static()]
    }

    #[test]
    fn every_effect_changes_the_force_and_size_zero_removes_it() {
        for (healthy, effect) in
            plants().into_iter().flat_map(|plant| EFFECTS.iter().map(move |e| (plant, e)))
        {
            let plain = force(&healthy, &Channels::PERFECT);
            let with = |size: f64| {
                let (mut plant, mut channels) = (healthy, Channels::PERFECT);
                if effect.id == "warm_start" {
                    plant = plant.with_temperature_fade_per_k(-0.002);
                }
                assert_eq!(inject(effect.id, size, &mut plant, &mut channels), Ok(()), "{}", effect.id);
                force(&plant, &channels)
            };
            let change = |force: &[f64]| {
                let squares = force.iter().zip(&plain).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
                (squares / plain.len() as f64).sqrt()
            };
            let (there, away) = (change(&with(effect.typical)), change(&with(0.0)));
            assert!((0.1..300.0).contains(&there), "{}: {there} N", effect.id);
            // The warm start is tested on a damper with thermal fade, which fades a little after a cold start too.
            let least = if effect.id == "warm_start" { 2.0 } else { 1e-6 };
            assert!(away < least, "{}: {away} N without it", effect.id);
        }
    }

    #[test]
    fn the_plant_can_be_integrated_at_both_ends_of_every_range() {
        for healthy in [Plant::default(), Plant::quasi_static()] {
            for effect in EFFECTS {
                for size in [effect.range.0, effect.range.1] {
                    let (mut plant, mut channels) = (healthy, Channels::default());
                    assert_eq!(inject(effect.id, size, &mut plant, &mut channels), Ok(()), "{}", effect.id);
                    let force = force(&plant, &channels);
                    assert!(force.iter().all(|f| f.abs() < 2e4), "{} {size}", effect.id);
                }
            }
        }
    }

    /// Change of the force by `id`, sample by sample, and the displacement.
    fn changes(id: &str, size: f64) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let (mut plant, mut channels) = (Plant::quasi_static(), Channels::PERFECT);
        let plain = force(&plant, &channels);
        assert_eq!(inject(id, size, &mut plant, &mut channels), Ok(()), "{id}");
        let changed: Vec<f64> = force(&plant, &channels).iter().zip(&plain).map(|(a, b)| a - b).collect();
        let x = Experiment::thesis("RP3-CS").map(|e| record(&e.with_duration_s(14.0), &plant, &channels, 1));
        (changed, plain, x.unwrap_or_default().displacement_m.values)
    }

    #[test]
    fn effects_outside_the_library_match_their_descriptions() {
        let samples = 14 * 512;
        let (loss, plain, x) = changes("force_loss", 0.1);
        assert!(loss[..samples / 2].iter().all(|f| *f == 0.0));
        assert!(
            loss[samples / 2..].iter().zip(&plain[samples / 2..]).all(|(f, p)| (f + 0.1 * p).abs() < 1e-9)
        );
        let (wear, _, _) = changes("wear_step", 0.2);
        assert!(wear[..=samples / 3 - 1].iter().all(|f| *f == 0.0));
        let later = &wear[samples / 3 + 1..];
        // A fifth of the yield force, which is between 80 N and 780 N.
        let greatest = later.iter().fold(0.0f64, |most, f| most.max(f.abs()));
        assert!((0.2 * 80.0..0.2 * 780.0).contains(&greatest), "{greatest} N");
        let (hum, _, _) = changes("mains_hum", 10.0);
        let power = hum.iter().map(|f| f * f).sum::<f64>() / samples as f64;
        assert!((power / 50.0 - 1.0).abs() < 1e-3 && hum.iter().all(|f| f.abs() < 10.0 + 1e-9), "{power}");
        let (ripple, _, _) = changes("position_ripple", 0.2);
        for ((f, p), x) in ripple.iter().zip(&plain).zip(&x) {
            let expected = 0.2 * p * (std::f64::consts::TAU * x / 0.005).sin();
            assert!((f - expected).abs() < 1e-6 * p.abs().max(1.0), "{f} for {expected} at {x} m");
        }
    }

    #[test]
    fn unknown_effects_and_sizes_out_of_range_are_rejected_with_the_choices() {
        let (mut plant, mut channels) = (Plant::default(), Channels::default());
        let mut refused = |id: &str, size| {
            inject(id, size, &mut plant, &mut channels).err().map(|e| e.to_string()).unwrap_or_default()
        };
        let unknown = refused("stiction", 1.0);
        assert!(unknown.contains("stiction") && unknown.contains("coil_lag, remanence"), "{unknown}");
        assert_eq!(refused("friction", -1.0), "effect friction is -1 N, but must be 0 to 1000");
        assert!(refused("coil_lag", f64::NAN).contains("NaN"));
    }
}
