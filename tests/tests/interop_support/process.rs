//! Programs of a lab: their JSON lines and their exit.

use serde_json::Value;
use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Time that a program gets to end before it is killed.
const GRACE: Duration = Duration::from_secs(5);

/// A file of tests/interop.
pub(crate) fn script(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("interop").join(name)
}

/// The last lines of a log file, and the panic messages before them.
pub(crate) fn tail(path: &Path) -> String {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let lines: Vec<_> = text.lines().collect();
    let (before, last) = lines.split_at(lines.len().saturating_sub(25));
    // A panic's location, and the message on the next line.
    let panics = before.iter().zip(before.iter().skip(1)).filter(|(line, _)| line.contains("panicked at"));
    let panics = panics.flat_map(|(line, message)| [line, message]);
    panics.chain(last).map(|line| format!("{line}\n")).collect()
}

/// Resident memory of a process, MiB.
pub(crate) fn resident_mib(process: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).expect("it runs");
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("a line of /proc");
    line.split_whitespace().next().and_then(|kib| kib.parse::<u64>().ok()).expect("a number") / 1024
}

/// A running program. Dropping it ends the program.
pub(crate) struct Program {
    name: String,
    child: Child,
    lines: Receiver<String>,
    status: Option<ExitStatus>,
    /// Open for a program that takes commands.
    stdin: Option<ChildStdin>,
}

impl Program {
    pub(crate) fn spawn(name: &str, command: Command, log: &Path) -> Self {
        Self::spawn_with(name, command, log, Stdio::null())
    }

    /// A program that takes commands: see [`Program::command`].
    pub(crate) fn spawn_told(name: &str, command: Command, log: &Path) -> Self {
        Self::spawn_with(name, command, log, Stdio::piped())
    }

    fn spawn_with(name: &str, mut command: Command, log: &Path, stdin: Stdio) -> Self {
        let stderr = File::create(log).expect("a log file in the laboratory's directory");
        let mut child = command
            .stdin(stdin)
            .stdout(Stdio::piped())
            .stderr(stderr)
            .process_group(0) // its children, if any, can be ended with it
            .spawn()
            .unwrap_or_else(|error| panic!("{name} did not start: {error}"));
        let stdout = child.stdout.take().expect("piped");
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(stdout).lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    break;
                }
            }
        });
        let stdin = child.stdin.take();
        Self { name: name.to_owned(), child, lines, status: None, stdin }
    }

    /// The next line of standard output, as JSON.
    pub(crate) fn json_line(&mut self, timeout: Duration) -> Value {
        match self.lines.recv_timeout(timeout) {
            Ok(line) => serde_json::from_str(&line)
                .unwrap_or_else(|error| panic!("{}: no JSON line ({error}): {line}", self.name)),
            Err(RecvTimeoutError::Timeout) => panic!("{} printed nothing for {timeout:?}", self.name),
            Err(RecvTimeoutError::Disconnected) => {
                let status = self.wait(GRACE);
                panic!("{} ended without a result: {status}", self.name)
            }
        }
    }

    /// Writes a line to standard input, and returns the line of JSON that answers it.
    pub(crate) fn command(&mut self, line: &str) -> Value {
        let stdin = self.stdin.as_mut().expect("a program that takes commands");
        writeln!(stdin, "{line}").unwrap_or_else(|error| panic!("{} takes no command: {error}", self.name));
        self.json_line(GRACE)
    }

    /// Closes standard input, which ends a program that takes commands. Returns its last line as JSON, and checks
    /// that it succeeded.
    pub(crate) fn close(mut self) -> Value {
        self.stdin = None;
        let said = self.json_line(GRACE);
        assert!(self.wait(GRACE).success(), "{} failed", self.name);
        said
    }

    /// Waits for a program to succeed; its whole standard output is one JSON text.
    pub(crate) fn json(mut self, timeout: Duration) -> Value {
        let text = self.output(timeout);
        serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: no JSON ({error}): {text}", self.name))
    }

    /// Waits for a program to succeed, and returns its standard output.
    pub(crate) fn output(&mut self, timeout: Duration) -> String {
        let status = self.wait(timeout);
        assert!(status.success(), "{} failed: {status}", self.name);
        self.lines.iter().collect::<Vec<_>>().join("\n")
    }

    /// Waits for the program to end.
    pub(crate) fn wait(&mut self, timeout: Duration) -> ExitStatus {
        self.try_wait(timeout).unwrap_or_else(|| panic!("{} still runs after {timeout:?}", self.name))
    }

    /// True while the program runs.
    pub(crate) fn is_running(&mut self) -> bool {
        self.try_wait(Duration::ZERO).is_none()
    }

    fn try_wait(&mut self, timeout: Duration) -> Option<ExitStatus> {
        let deadline = Instant::now() + timeout;
        while self.status.is_none() {
            self.status = self.child.try_wait().expect("a child of ours");
            if self.status.is_none() {
                if Instant::now() >= deadline {
                    return None;
                }
                std::thread::sleep(Duration::from_millis(2));
            }
        }
        self.status
    }

    /// Its process id.
    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// Sends a signal such as `INT`, `TERM` or `STOP` to the program only.
    pub(crate) fn signal(&self, signal: &str) {
        let sent = self.send(signal, &self.child.id().to_string());
        assert!(sent, "SIG{signal} could not be sent to {}", self.name);
    }

    fn send(&self, signal: &str, target: &str) -> bool {
        // Without `--`, which dash takes for a process.
        let shell = format!("kill -{signal} {target} 2>/dev/null");
        Command::new("sh").args(["-c", &shell]).status().is_ok_and(|status| status.success())
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        self.stdin = None;
        if self.status.is_none() && self.send("TERM", &self.child.id().to_string()) {
            self.try_wait(GRACE);
        }
        // Until the process has been waited for, its id and its group's id cannot be reused.
        if self.status.is_none() {
            self.send("KILL", &format!("-{}", self.child.id()));
            let _ = self.child.wait();
        }
    }
}
