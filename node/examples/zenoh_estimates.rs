//! Prints the force of every damper, received over Zenoh. It uses an ordinary Zenoh session and nothing of this
//! project.
//!
//! cargo run --release --example zenoh_estimates -- tcp/127.0.0.1:7447 [COUNT]

use zenoh::Wait;

fn main() -> zenoh::Result<()> {
    let mut words = std::env::args().skip(1);
    let endpoint = words.next().ok_or("usage: zenoh_estimates ENDPOINT [COUNT]")?;
    let count = words.next().map_or(Ok(usize::MAX), |text| text.parse())?;
    let mut config = zenoh::Config::default();
    config.insert_json5("mode", "\"client\"")?;
    config.insert_json5("connect/endpoints", &format!("[\"{endpoint}\"]"))?;
    config.insert_json5("connect/timeout_ms", "-1")?; // wait until the endpoint is there
    let session = zenoh::open(config).wait()?;
    let estimates = session.declare_subscriber("mr_damper/**/web/force_estimate").wait()?;
    for _ in 0..count {
        let sample = estimates.recv()?;
        let said: serde_json::Value = serde_json::from_slice(&sample.payload().to_bytes())?;
        println!("{} {} N {}", sample.key_expr(), said["force_n"], said["validity"]);
    }
    Ok(())
}
