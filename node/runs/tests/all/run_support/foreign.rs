//! A run under foreign names: the same readings in a bag and in a CSV file, with the map that reads the bag.

use super::{at, bag};
use mr_damper_msgs::geometry::{Twist, TwistStamped, Vector3, Wrench, WrenchStamped};
use mr_damper_msgs::standard::{Float64, JointState, Range, Temperature};
use mr_damper_runs::{BagOptions, Topic};
use std::path::Path;

pub(crate) const STEPS: i64 = 50;

/// Raw readings of a step in the units of a foreign vehicle: (mm, m/s, kN, mA, °F, m).
pub(crate) fn raw(step: i64) -> [f64; 6] {
    let x = step as f64 * 0.1;
    [
        x.sin() * 31.7,
        x.cos() * 0.3,
        x.sin() * 1.1,
        400.0 + x,
        71.3 + x,
        f64::from((0.3 + 0.01 * x.sin()) as f32),
    ]
}

/// A bag whose topics have their own names and types.
pub(crate) fn foreign(dir: &Path, options: BagOptions) {
    bag(dir, options, |writer| {
        for step in 1..=STEPS {
            let (nanos, [pos, velocity, force, current, temperature, range]) = (step * 2_000_001, raw(step));
            let header = at(nanos);
            let float = |data| Float64 { data };
            writer.write_message("/fl/susp/pos", &float(pos), nanos, nanos)?;
            let vector = |z: f64| Vector3 { x: -z, y: 0.0, z };
            let twist = Twist { linear: vector(velocity), angular: vector(9.0) };
            writer.write_message(
                "/fl/twist",
                &TwistStamped { header: header.clone(), twist },
                nanos,
                nanos,
            )?;
            let wrench = Wrench { force: vector(force), torque: vector(9.0) };
            let wrench = WrenchStamped { header: header.clone(), wrench };
            writer.write_message("/fl/load_cell", &wrench, nanos, nanos)?;
            writer.write_message("/fl/amps", &float(current), nanos, nanos)?;
            let oil = Temperature { header: header.clone(), temperature, variance: 0.0 };
            writer.write_message("/fl/oil", &oil, nanos, nanos)?;
            let ray = Range { header: header.clone(), range: range as f32, ..Range::default() };
            writer.write_message("/fl/ray", &ray, nanos, nanos)?;
            let joints = JointState {
                header,
                name: vec!["wheel".into(), "fl_damper".into()],
                position: vec![0.0, pos],
                velocity: vec![],
                effort: vec![0.0, force],
            };
            writer.write_message("/joint_states", &joints, nanos, nanos)?;
        }
        let imu = Topic { name: "/imu", type_name: "sensor_msgs/msg/Imu", ..Topic::of::<Float64>("/imu") };
        let imu = writer.topic(&imu)?;
        writer.write(imu, 1, 1, &[0, 1, 0, 0])?;
        writer.topic(&Topic::of::<Float64>("/fl/silent")).map(|_| ())
    });
}

/// The same readings under our names, for conversion by `load`.
pub(crate) fn ours_csv(path: &Path) {
    let mut text =
        "time_s,displacement_mm,velocity_m_s,force_kn,current_ma,case_temp_f,setpoint_m\n".to_owned();
    for step in 1..=STEPS {
        let nanos = step * 2_000_001;
        let [pos, velocity, force, current, temperature, range] = raw(step);
        text += &format!("0.{nanos:09},{pos},{velocity},{force},{current},{temperature},{range}\n");
    }
    std::fs::write(path, text).expect("written");
}

pub(crate) const OF_BAG: [&str; 6] = [
    "displacement=/fl/susp/pos,unit=mm",
    "velocity=/fl/twist:z",
    "measured_force=/fl/load_cell:z,unit=kN",
    "coil_current=/fl/amps,unit=mA",
    "case_temperature=/fl/oil,unit=F",
    "setpoint=/fl/ray",
];
