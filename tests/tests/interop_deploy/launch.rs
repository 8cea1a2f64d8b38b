//! The ROS package, installed by its CMake, and its launch files.
//!
//! `launch_files.py` replaces `ros2 launch`, which no wheel contains; tests/interop/README.md describes its limits.

use super::super::PEER;
use crate::interop_support::gate::{Outcome, binary, interop};
use crate::interop_support::json::{found, number, text, truth};
use crate::interop_support::process::{Program, script};
use crate::interop_support::{Distro, Lab, PRESET};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

const CORNERS: [&str; 4] = ["front_left", "front_right", "rear_left", "rear_right"];
/// Longest time from SIGINT to the end of all processes; `ros2 launch` kills after 5 s.
const SHUTDOWN: Duration = Duration::from_secs(2);

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn launch_files_start_one_damper() {
    interop("launch files, one damper", |lab| {
        let package = Package::install(lab);
        let arguments = ["namespace:=rear", "use_sim_time:=true", "autostart:=false"];
        for form in ["py", "xml"] {
            let (saw, codes) =
                package.launch(&format!("damper.launch.{form}"), &arguments, &["/rear/mr_damper"]);
            let told = &saw["/rear/mr_damper"];
            assert_eq!(text(told, "/model"), PRESET, "{form}: {told:#}");
            assert!(truth(told, "/use_sim_time") && !truth(told, "/autostart"), "{form}: {told:#}");
            assert_eq!(codes, [0], "{form}");
        }
        package.both_forms_say("damper", &arguments);
        package.both_forms_say("damper", &["model:=own.toml", "log_level:=debug", "name:=left"]);
        Outcome::Passed(format!("{} starts from Python and XML", package.binary().display()))
    });
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn launch_files_start_a_vehicle() {
    interop("launch files, a vehicle", |lab| {
        let package = Package::install(lab);
        let nodes = CORNERS.map(|corner| format!("/{corner}/mr_damper"));
        let nodes = nodes.each_ref().map(String::as_str);
        for (form, separate, processes) in [("py", "separate:=true", 4), ("xml", "separate:=false", 1)] {
            let arguments = [separate, "use_sim_time:=true"];
            let (saw, codes) = package.launch(&format!("vehicle.launch.{form}"), &arguments, &nodes);
            let of = |name: &str| CORNERS.map(|corner| number(&saw[format!("/{corner}/mr_damper")], name));
            assert_eq!(of("/skyhook.damping_n_s_m"), [1500.0, 1500.0, 1200.0, 1200.0], "{separate}");
            assert_eq!(of("/displacement.sign"), [1.0, 1.0, 1.0, -1.0], "{separate}");
            for node in nodes {
                assert!(
                    truth(&saw[node], "/use_sim_time") && truth(&saw[node], "/autostart"),
                    "{separate}: {saw:#}"
                );
            }
            assert_eq!(codes, vec![0; processes], "{separate}");
        }
        for separate in ["separate:=true", "separate:=false"] {
            package.both_forms_say("vehicle", &[separate]);
        }
        Outcome::Passed("four dampers in one process and in four".to_owned())
    });
}

#[test]
#[ignore = "needs systemd-analyze"]
fn systemd_accepts_the_unit() {
    interop("systemd unit", |lab| {
        let unit = script("../../launch-configs/systemd/mr-damper@.service");
        let text = std::fs::read_to_string(unit).expect("the unit is there");
        // The program may not be installed on this machine, so its path replaces its name.
        let here = lab.folder().join("mr-damper@front_left.service");
        let binary = binary().canonicalize().expect("a path");
        let with_program = text.replace("ExecStart=mr-damper", &format!("ExecStart={}", utf8(&binary)));
        std::fs::write(&here, with_program).expect("room in the temporary directory");
        let analyze = |arguments: &[&str]| {
            let command = Command::new("systemd-analyze").args(arguments).arg(&here).output().ok()?;
            Some((command.status.success(), String::from_utf8_lossy(&command.stderr).into_owned()))
        };
        let Some((clean, says)) = analyze(&["verify"]) else {
            return Outcome::Missing("systemd-analyze is not installed".to_owned());
        };
        assert!(clean && says.is_empty(), "{says}");
        // In tenths; systemd calls exposures up to 2.0 "OK", the best level for a service with network access.
        let (hard, says) = analyze(&["security", "--offline=true", "--threshold=20"]).expect("as before");
        assert!(hard, "{says}");
        Outcome::Passed("systemd-analyze verify reports nothing, and the exposure is below 2.0".to_owned())
    });
}

/// The package, installed in its own directory.
struct Package<'a> {
    lab: &'a Lab,
    prefix: PathBuf,
}

impl<'a> Package<'a> {
    fn install(lab: &'a Lab) -> Self {
        let prefix = lab.folder().join("install");
        let output = Command::new(script("install-package.sh"))
            .arg(Distro::Jazzy.name())
            .args([lab.folder().join("build"), prefix.clone(), binary()])
            .output()
            .expect("tests/interop/install-package.sh starts");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        Self { lab, prefix }
    }

    fn binary(&self) -> PathBuf {
        self.prefix.join("lib/mr_damper/mr-damper")
    }

    fn started(&self, file: &str, before: &[&str], arguments: &[&str]) -> Program {
        let path = self.prefix.join("share/mr_damper/launch").join(file);
        let mut all = vec![utf8(&self.prefix)];
        all.extend(before);
        all.push(utf8(&path));
        all.extend(arguments);
        self.lab.ros(Distro::Jazzy, "launch_files.py", &all)
    }

    /// Launches `file`, reads the parameters of `nodes`, stops it by SIGINT; returns the parameters, and the exit codes of
    /// its processes.
    fn launch(&self, file: &str, arguments: &[&str], nodes: &[&str]) -> (Value, Vec<i64>) {
        let mut launched = self.started(file, &[], arguments);
        let pids = launched.json_line(PEER);
        let asked = "model,use_sim_time,autostart,skyhook.damping_n_s_m,displacement.sign";
        let mut watcher = self.lab.ros(Distro::Jazzy, "launch_peer.py", &[&[asked], nodes].concat());
        let saw = watcher.json_line(PEER);
        launched.signal("INT");
        let ended = launched.json_line(SHUTDOWN);
        assert!(launched.wait(SHUTDOWN).success(), "{file}: {pids:#}, {ended:#}");
        assert_eq!(text(&watcher.json_line(PEER), "/event"), "gone", "{file}");
        let codes = found(&ended, "/codes").as_array().expect("a list of codes").iter();
        (found(&saw, "/nodes").clone(), codes.map(|code| code.as_i64().expect("a code")).collect())
    }

    /// Checks that both forms of a launch file give the same commands, and at least one.
    fn both_forms_say(&self, name: &str, arguments: &[&str]) {
        let [python, xml] = ["py", "xml"]
            .map(|form| self.started(&format!("{name}.launch.{form}"), &["--print"], arguments).json(PEER));
        assert!(text(&python, "/commands/0/0").ends_with("lib/mr_damper/mr-damper"), "{python:#}");
        assert_eq!(python, xml, "{name} with {arguments:?}");
    }
}

fn utf8(path: &Path) -> &str {
    path.to_str().expect("a path in UTF-8")
}
