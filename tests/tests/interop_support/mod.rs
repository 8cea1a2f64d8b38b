//! A lab for interop tests: a separate network namespace, the programs in it, and their JSON output.
//!
//! Every program is ended by its process id when its handle is dropped, and the kernel ends it if this process is killed. Failure
//! messages include the last log lines of every program of the lab.

pub(crate) mod gate;
pub(crate) mod json;
pub(crate) mod process;

use process::{Program, script};
use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::rc::Rc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

/// The node's fully qualified name without remapping.
pub(crate) const NODE: &str = "/mr_damper";
/// A preset with which the node starts without further settings.
pub(crate) const PRESET: &str = "thesis/fuzzy-tanh/rp3-cs";
/// Endpoint of the Zenoh mirror in tests.
pub(crate) const ZENOH_ENDPOINT: &str = "tcp/127.0.0.1:7447";
/// Longest time until a program logs what a test waits for: start and discovery on a loaded machine.
const LOGGED: Duration = Duration::from_secs(30);

/// The ROS 2 distribution of a peer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Distro {
    Jazzy,
    Kilted,
}

impl Distro {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Jazzy => "jazzy",
            Self::Kilted => "kilted",
        }
    }
}

/// A network namespace with only loopback, a ROS domain, and a directory for files.
pub(crate) struct Lab {
    holder: Child,
    domain: u32,
    folder: tempfile::TempDir,
    logs: Rc<RefCell<Vec<(String, PathBuf)>>>,
}

impl Lab {
    pub(crate) fn new() -> Self {
        // Fast DDS shares memory by domain id, even across network namespaces, so each lab has a different id, also when these
        // tests run twice at the same time.
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let domain = 1 + (std::process::id() * 7 + NEXT.fetch_add(1, Ordering::Relaxed)) % 100;
        Self::of(domain, Rc::default())
    }

    /// Another host in the same domain, at the other end of a cable; `None` if only root can create it.
    pub(crate) fn neighbour(&self) -> Option<Self> {
        let other = Self::of(self.domain, Rc::clone(&self.logs));
        let ends = [self.holder.id(), other.holder.id()].map(|id| id.to_string());
        let wired = Command::new(script("netns.sh")).arg("wire").args(ends).status();
        wired.is_ok_and(|status| status.success()).then_some(other)
    }

    /// Another host in the same domain, behind a router that carries no multicast, together with that router, which must be kept.
    /// `None` if only root can create them.
    pub(crate) fn behind_a_router(&self) -> Option<[Self; 2]> {
        let [router, other] = [(); 2].map(|()| Self::of(self.domain, Rc::clone(&self.logs)));
        let all = [self.holder.id(), router.holder.id(), other.holder.id()].map(|id| id.to_string());
        let wired = Command::new(script("netns.sh")).arg("route").args(all).status();
        wired.is_ok_and(|status| status.success()).then_some([router, other])
    }

    /// Another host in the same domain, at the other end of a cable with controllable faults (`bad_wire.py`), and the cable.
    ///
    /// # Errors
    /// Why it cannot be created: it needs root and TAP devices.
    pub(crate) fn behind_a_bad_wire(&self, seed: u64) -> Result<(Self, Program), String> {
        let other = Self::of(self.domain, Rc::clone(&self.logs));
        let [near, far] = [self.holder.id(), other.holder.id()].map(|id| id.to_string());
        if !Path::new("/dev/net/tun").exists() {
            return Err("/dev/net/tun is missing; try `modprobe tun`".to_owned());
        }
        let mut command = Command::new("python3");
        command.arg(script("bad_wire.py")).args([&near, &far, "--seed", &seed.to_string()]);
        let mut wire = Program::spawn_told("bad_wire.py", command, &self.log("bad_wire.py"));
        let said = wire.json_line(std::time::Duration::from_secs(10));
        match json::text(&said, "/event") {
            "up" => Ok((other, wire)),
            _ => Err(format!("cannot create a TAP device: {}", json::text(&said, "/why"))),
        }
    }

    fn of(domain: u32, logs: Rc<RefCell<Vec<(String, PathBuf)>>>) -> Self {
        let folder = tempfile::tempdir().expect("a temporary directory");
        let mut holder = Command::new(script("netns.sh"))
            .arg("hold")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("tests/interop/netns.sh starts");
        let mut line = String::new();
        let stdout = holder.stdout.as_mut().expect("piped");
        std::io::BufRead::read_line(&mut std::io::BufReader::new(stdout), &mut line).expect("readable");
        assert_eq!(
            line.trim(),
            holder.id().to_string(),
            "no network namespace: `tests/interop/netns.sh hold` should print its process id and wait; \
             its message above gives the cause"
        );
        Self { holder, domain, folder, logs }
    }

    /// A directory that is removed with the lab.
    pub(crate) fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Starts the node with `-p model:=MODEL` and additional ROS arguments.
    pub(crate) fn node(&self, model: &str, ros_args: &[&str]) -> Program {
        let model = format!("model:={model}");
        let mut args = vec!["node", "--ros-args", "-p", &model];
        args.extend(ros_args);
        self.mr_damper(&args)
    }

    /// Like [`Self::node`], with an `mr-damper` of the hardened build.
    ///
    /// # Errors
    /// Why there is no hardened build.
    pub(crate) fn hardened_node(&self, ros_args: &[&str]) -> Result<Program, String> {
        let model = format!("model:={PRESET}");
        let args = [&["node", "--ros-args", "-p", &model], ros_args].concat();
        Ok(self.start("mr-damper node", &gate::hardened_binary()?, &args))
    }

    /// Starts `mr-damper` with `args`.
    pub(crate) fn mr_damper(&self, args: &[&str]) -> Program {
        self.start(&format!("mr-damper {}", args[0]), &gate::binary(), args)
    }

    /// Starts the bare echo.
    pub(crate) fn echo(&self) -> Program {
        self.start("echo_peer", &gate::echo_binary(), &[])
    }

    /// Starts a script of tests/interop with a real ROS 2.
    pub(crate) fn ros(&self, distro: Distro, file: &str, args: &[&str]) -> Program {
        let file = script(file);
        let mut all = vec![distro.name(), file.to_str().expect("UTF-8 path")];
        all.extend(args);
        self.start(&format!("{} {}", distro.name(), all[1]), &script("ros-python.sh"), &all)
    }

    /// Like [`Self::ros`], for a script that ends when its standard input closes.
    pub(crate) fn ros_commanded(&self, distro: Distro, file: &str, args: &[&str]) -> Program {
        let name = file;
        let file = script(file);
        let mut all = vec![distro.name(), file.to_str().expect("UTF-8 path")];
        all.extend(args);
        self.start_commanded(name, &script("ros-python.sh"), &all)
    }

    /// Starts a script of tests/interop with the Python environment of CycloneDDS and Zenoh.
    pub(crate) fn peer(&self, file: &str, args: &[&str]) -> Program {
        let script = script(file);
        let mut all = vec![script.to_str().expect("UTF-8 path")];
        all.extend(args);
        self.start(file, &gate::environment("peers").join("venv/bin/python"), &all)
    }

    fn start(&self, name: &str, program: &Path, args: &[&str]) -> Program {
        self.start_with(name, program, args, &[])
    }

    /// Starts another program, with its own environment variables.
    pub(crate) fn start_with(
        &self,
        name: &str,
        program: &Path,
        args: &[&str],
        variables: &[(&str, &Path)],
    ) -> Program {
        let log = self.log(name);
        Program::spawn(name, self.command(program, args, variables), &log)
    }

    /// Starts a program that takes commands: see [`Program::command`].
    pub(crate) fn start_commanded(&self, name: &str, program: &Path, args: &[&str]) -> Program {
        let log = self.log(name);
        Program::spawn_told(name, self.command(program, args, &[]), &log)
    }

    /// A log file for the standard error of the next program.
    fn log(&self, name: &str) -> PathBuf {
        let mut logs = self.logs.borrow_mut();
        let log = self.folder().join(format!("{}.log", logs.len()));
        logs.push((name.to_owned(), log.clone()));
        log
    }

    fn command(&self, program: &Path, args: &[&str], variables: &[(&str, &Path)]) -> Command {
        let mut command = Command::new(script("netns.sh"));
        command.arg("enter").arg(self.holder.id().to_string()).arg(program).args(args);
        command.env("ROS_DOMAIN_ID", self.domain.to_string()).env("PYTHONDONTWRITEBYTECODE", "1");
        for name in
            ["ROS_LOCALHOST_ONLY", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS", "CYCLONEDDS_URI"]
        {
            command.env_remove(name);
        }
        for (name, value) in variables {
            command.env(name, value);
        }
        command
    }

    /// The last stderr lines of the program that was last started with this name.
    pub(crate) fn last_log(&self, program: &str) -> String {
        let logs = self.logs.borrow();
        let last = logs.iter().rfind(|(name, _)| name == program);
        last.map(|(_, path)| process::tail(path)).unwrap_or_else(|| panic!("{program} was not started"))
    }

    /// Waits until the last stderr lines of a program contain `words`.
    pub(crate) fn wait_for_log(&self, program: &str, words: &str) {
        let deadline = Instant::now() + LOGGED;
        while !self.last_log(program).contains(words) {
            assert!(Instant::now() < deadline, "waited {LOGGED:?} for \"{words}\" in the log of {program}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// The last stderr lines of each program.
    pub(crate) fn logs(&self) -> String {
        let mut text = String::new();
        for (name, path) in self.logs.borrow().iter() {
            text += &format!("--- stderr of {name}\n{}", process::tail(path));
        }
        text
    }
}

impl Drop for Lab {
    fn drop(&mut self) {
        drop(self.holder.stdin.take()); // it lives until its standard input closes
        let _ = self.holder.wait();
    }
}
