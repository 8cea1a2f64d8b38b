//! A page served by its own process, and its readers over plain TCP.

use serde_json::Value as Json;
use socket2::{Domain, SockRef, Socket, Type};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Timeout of an answer on a busy machine.
const ANSWER: Duration = Duration::from_secs(10);

/// `mr-damper serve` on a free port. It is killed at the end of the test, even if the test fails.
pub(crate) struct Page {
    pub(crate) child: Child,
    address: SocketAddr,
}

/// An answer to a request.
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) head: String,
    pub(crate) body: String,
}

impl Page {
    pub(crate) fn start(arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
        command.args(["serve", "--listen", "127.0.0.1:0"]).args(arguments);
        let mut child = command.stdout(Stdio::piped()).spawn().expect("it starts");
        let mut line = String::new();
        let stdout = child.stdout.as_mut().expect("piped");
        BufReader::new(stdout).read_line(&mut line).expect("it says where it is");
        let address = line.trim().strip_prefix("http://").and_then(|rest| rest.strip_suffix('/'));
        let address =
            address.and_then(|text| text.parse().ok()).unwrap_or_else(|| panic!("no address: {line}"));
        Self { child, address }
    }

    /// The page's own host name and port.
    pub(crate) fn host(&self) -> String {
        self.address.to_string()
    }

    /// Sends `request` (method and path) with `host` in its header, and returns the answer.
    pub(crate) fn ask(&self, request: &str, host: &str, headers: &str) -> Answer {
        let mut stream = TcpStream::connect(self.address).expect("it listens");
        stream.set_read_timeout(Some(ANSWER)).expect("a time");
        write!(stream, "{request}HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{headers}\r\n")
            .expect("sent");
        let mut reader = BufReader::new(stream);
        let (status, head) = head(&mut reader);
        // An event stream has no end, so only its head is read.
        let mut body = String::new();
        if !head.contains("text/event-stream") {
            reader.read_to_string(&mut body).expect("text");
        }
        Answer { status, head, body }
    }

    /// The token that a page of `serve --workshop` contains and sends with its requests.
    pub(crate) fn token(&self) -> String {
        let whole = self.ask("GET / ", &self.host(), "").body;
        let rest = whole.split("mr-damper-token\" content=\"").nth(1).expect("a workshop's page");
        rest.split('"').next().expect("a token").to_owned()
    }

    /// The answer to a POST with this body, with the headers that the page sends.
    pub(crate) fn post(&self, path: &str, body: &[u8]) -> Answer {
        let headers = format!("Origin: http://{}\r\nX-Mr-Damper-Token: {}\r\n", self.host(), self.token());
        self.post_with(path, &headers, body)
    }

    /// Like [`Self::post`], with only these headers.
    pub(crate) fn post_with(&self, path: &str, headers: &str, body: &[u8]) -> Answer {
        Self::finish_post(self.begin_post(path, headers, body.len()), body)
    }

    /// Like [`Self::post_with`], with a body that is already in chunks, so that no header announces its
    /// length.
    pub(crate) fn post_chunked(&self, path: &str, headers: &str, chunks: &[u8]) -> Answer {
        let mut stream = TcpStream::connect(self.address).expect("it listens");
        stream.set_read_timeout(Some(6 * ANSWER)).expect("a time");
        let host = self.host();
        write!(stream, "POST {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{headers}Transfer-Encoding: chunked\r\n\r\n")
            .expect("sent");
        Self::finish_post(stream, chunks)
    }

    fn finish_post(mut stream: TcpStream, body: &[u8]) -> Answer {
        // A server that refuses a request does not read the rest.
        let _ = stream.write_all(body);
        let mut reader = BufReader::new(stream);
        let (status, head) = head(&mut reader);
        let mut text = String::new();
        // Unread data resets the connection at its end, but the answer has arrived before that.
        let _ = reader.read_to_string(&mut text);
        Answer { status, head, body: text }
    }

    /// Begins a POST that announces `length` bytes, without sending any of them.
    pub(crate) fn begin_post(&self, path: &str, headers: &str, length: usize) -> TcpStream {
        let mut stream = TcpStream::connect(self.address).expect("it listens");
        stream.set_read_timeout(Some(6 * ANSWER)).expect("a time");
        let host = self.host();
        write!(stream, "POST {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{headers}Content-Length: {length}\r\n\r\n")
            .expect("sent");
        stream
    }

    /// The part of the snapshot about `--workshop`: uploads, runs, replay and diagnoses.
    pub(crate) fn workshop(&self) -> Json {
        self.snapshot()["workshop"].clone()
    }

    /// Like [`Self::workshop`], once `is` returns true.
    pub(crate) fn workshop_once(&self, what: &str, within: Duration, is: impl Fn(&Json) -> bool) -> Json {
        let deadline = Instant::now() + within;
        loop {
            let shown = self.workshop();
            if is(&shown) {
                return shown;
            }
            assert!(Instant::now() < deadline, "waited for {what}: {shown:#}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// The whole snapshot.
    pub(crate) fn snapshot(&self) -> Json {
        let answer = self.ask("GET /snapshot ", &self.host(), "");
        assert_eq!(answer.status, 200, "{}", answer.head);
        serde_json::from_str(&answer.body).unwrap_or_else(|error| panic!("{error}: {}", answer.body))
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Status and head of an answer.
fn head(reader: &mut impl BufRead) -> (u16, String) {
    let mut head = String::new();
    while !head.ends_with("\r\n\r\n") {
        assert!(reader.read_line(&mut head).expect("a head") > 0, "the head ends early: {head}");
    }
    let status = head.split_whitespace().nth(1).and_then(|status| status.parse().ok());
    (status.unwrap_or_else(|| panic!("no status in {head}")), head)
}

/// An event of a stream.
#[derive(Debug)]
pub(crate) struct StreamEvent {
    pub(crate) name: String,
    pub(crate) data: Json,
    pub(crate) at: Instant,
}

/// An open stream of events.
pub(crate) struct Stream(BufReader<TcpStream>);

impl Stream {
    pub(crate) fn open(page: &Page) -> Self {
        Self::over(TcpStream::connect(page.address).expect("it listens"), page)
    }

    /// A stream with a small receive buffer, so that it can stall.
    pub(crate) fn open_with_small_buffer(page: &Page) -> Self {
        let socket = Socket::new(Domain::IPV4, Type::STREAM, None).expect("a socket");
        socket.set_recv_buffer_size(4096).expect("a size");
        socket.connect(&page.address.into()).expect("it listens");
        Self::over(socket.into(), page)
    }

    fn over(mut stream: TcpStream, page: &Page) -> Self {
        stream.set_read_timeout(Some(ANSWER)).expect("a time");
        // With HTTP/1.0 the stream is not chunked.
        write!(stream, "GET /events HTTP/1.0\r\nHost: {}\r\n\r\n", page.host()).expect("sent");
        let mut reader = BufReader::new(stream);
        let (status, head) = head(&mut reader);
        assert_eq!(status, 200, "{head}");
        assert!(head.contains("text/event-stream"), "{head}");
        Self(reader)
    }

    /// Enlarges the receive buffer, so that the reader catches up.
    pub(crate) fn widen(&self) {
        SockRef::from(self.0.get_ref()).set_recv_buffer_size(1 << 20).expect("a size");
    }

    fn next(&mut self) -> StreamEvent {
        let (mut name, mut data) = (String::new(), String::new());
        loop {
            let mut line = String::new();
            assert!(self.0.read_line(&mut line).expect("an event") > 0, "the stream has ended");
            match line.trim_end().split_once(": ") {
                Some(("event", value)) => name = value.to_owned(),
                Some(("data", value)) => data += value,
                Some(_) => {}
                None if data.is_empty() => {}
                None => {
                    let data = serde_json::from_str(&data).unwrap_or_else(|error| panic!("{error}: {data}"));
                    return StreamEvent { name, data, at: Instant::now() };
                }
            }
        }
    }

    /// All events until `done`, and one more.
    pub(crate) fn read_until(mut self, done: impl Fn() -> bool) -> Vec<StreamEvent> {
        let mut all = Vec::new();
        while !done() {
            all.push(self.next());
        }
        all
    }

    /// All events up to the first one called `name`.
    pub(crate) fn read_until_event(&mut self, name: &str) -> Vec<StreamEvent> {
        let (mut all, begun) = (vec![self.next()], Instant::now());
        while all[all.len() - 1].name != name {
            assert!(begun.elapsed() < 2 * ANSWER, "no {name} among {} events", all.len());
            all.push(self.next());
        }
        all
    }
}
