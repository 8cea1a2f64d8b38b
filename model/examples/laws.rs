//! Draws the force-velocity loops of force laws, for a damper of about 1 kN on a sine of 15 mm at 2 Hz.
//!
//! ```text
//! cargo run --release -p mr-damper-model --example laws
//! ```

use mr_damper_model::force::{Dependence, ForceLaw, Inputs, LawModel, LawState};
use std::f64::consts::TAU;

const WIDTH: usize = 49;
const HEIGHT: usize = 13;
const RATE_HZ: f64 = 512.0;
const FREQUENCY_HZ: f64 = 2.0;
const AMPLITUDE_M: f64 = 0.015;

/// Laws with their parameters, in the order of [`ForceLaw::parameters`].
const LAWS: [(ForceLaw, &[f64]); 8] = [
    (ForceLaw::Sp, &[700.0, 1_500.0, 25.0, 0.06, 0.015]),
    (ForceLaw::BoucWen, &[1_500.0, 60_000.0, 8_000.0, 1_000.0, 700.0, 900.0, 1.2, 300.0, 1_000.0]),
    (ForceLaw::Kwok, &[1_500.0, 3_000.0, 700.0, 25.0, 0.8]),
    (ForceLaw::Li, &[700.0, 50.0, 0.04, 1_500.0, 2_000.0, 700.0, 50.0, -0.04, 1_500.0, 2_000.0]),
    (ForceLaw::CesmeciEngin, &[1_500.0, 800.0, 40.0, 0.04, 10.0]),
    // An odd polynomial, 13.5e3 u - 440e3 u^3 + 5.6e6 u^5, at u = v - 0.03 and at u = v + 0.03.
    (
        ForceLaw::Choi,
        &[
            -393.3, 12_335.0, 38_088.0, -389_600.0, -840e3, 5.6e6, 0.0, 393.3, 12_335.0, -38_088.0,
            -389_600.0, 840e3, 5.6e6, 0.0,
        ],
    ),
    (ForceLaw::Arctan, &[800.0, 1_500.0, 40.0, 0.06, 0.015]),
    (ForceLaw::Linear, &[5_000.0, 2_000.0]),
];

/// Velocity and force over one period, after one settling period.
fn cycle(model: &LawModel) -> Vec<(f64, f64)> {
    let omega = TAU * FREQUENCY_HZ;
    let period = (RATE_HZ / FREQUENCY_HZ) as usize;
    let mut state = LawState::default();
    let point = |k: usize| {
        let t = k as f64 / RATE_HZ;
        let inputs = Inputs {
            dt_s: (k > 0).then_some(1.0 / RATE_HZ),
            displacement_m: AMPLITUDE_M * (omega * t).sin(),
            velocity_m_s: AMPLITUDE_M * omega * (omega * t).cos(),
            acceleration_m_s2: -AMPLITUDE_M * omega * omega * (omega * t).sin(),
            drive: f64::NAN,
            case_temp_c: f64::NAN,
        };
        (inputs.velocity_m_s, model.force_n(&inputs, &mut state))
    };
    (0..2 * period).map(point).skip(period).collect()
}

/// The loop as text: velocity to the right, force upwards; `+` where velocity rises, `o` where it falls.
fn draw(points: &[(f64, f64)]) -> String {
    let peak = |of: fn(&(f64, f64)) -> f64| points.iter().map(|p| of(p).abs()).fold(0.0, f64::max);
    let (speed, force) = (peak(|p| p.0), peak(|p| p.1));
    let place = |share: f64, cells: usize| ((share + 1.0) / 2.0 * (cells - 1) as f64).round() as usize;
    let mut canvas = [[b' '; WIDTH]; HEIGHT];
    canvas[HEIGHT / 2] = [b'-'; WIDTH];
    canvas.iter_mut().for_each(|line| line[WIDTH / 2] = b'|');
    for (k, (v, f)) in points.iter().enumerate() {
        let rising = points[(k + 1) % points.len()].0 > *v;
        let (column, row) = (place(v / speed, WIDTH), HEIGHT - 1 - place(f / force, HEIGHT));
        canvas[row][column] = if rising { b'+' } else { b'o' };
    }
    let lines: Vec<String> =
        canvas.iter().map(|line| String::from_utf8_lossy(line).trim_end().to_owned()).collect();
    format!("{}\n  +-{force:.0} N over +-{:.0} mm/s", lines.join("\n"), speed * 1e3)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for (law, parameters) in LAWS {
        let model = LawModel::new(law, Dependence::None, parameters, 0.0)?;
        let points = cycle(&model);
        // Work per cycle, from the closed force-displacement loop.
        let work_j: f64 = points.iter().map(|(v, f)| v * f / RATE_HZ).sum();
        println!("{} ({} parameters), {work_j:.1} J per cycle", law.name(), model.parameter_count());
        println!("{}\n", draw(&points));
    }
    Ok(())
}
