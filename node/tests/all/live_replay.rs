//! The player over real DDS: its services, called as a client of `ros2 bag play` calls them, and
//! `/clock`.

use crate::domain::Domain;
use crate::live_support::{Ended, answer};
use crate::turn::turn;
use crate::wait::wait_until;
use mr_damper_model::sample::{DriveKind, Run, Stamp, Trace};
use mr_damper_msgs::rosbag2::{
    Burst, BurstRequest, GetRate, GetRateRequest, IsPaused, IsPausedRequest, Pause, PauseRequest, PlayNext,
    PlayNextRequest, Resume, ResumeRequest, Seek, SeekRequest, SetRate, SetRateRequest, TogglePaused,
    TogglePausedRequest,
};
use mr_damper_msgs::standard::{Clock, Time};
use mr_damper_msgs::{CoilCurrent, Displacement, Force, Service};
use mr_damper_node::ros2::participant::{ClientOf, Ros};
use mr_damper_node::settings::config::{Config, RosArgs};
use mr_damper_node::settings::interrupt::Interrupt;
use mr_damper_node::streams::player::{PlaybackOptions, Played, Player};
use ros2_client::{NodeOptions, Subscription};
use std::time::{Duration, Instant};

const EPOCH: i64 = 1_700_000_000_000_000_000;
const SPACING: i64 = 10_000_000;
const SAMPLES: i64 = 600;

/// Displacement number `k` is `k` m; samples are 10 ms apart.
fn run() -> Run {
    let stamps: Vec<Stamp> = (0..SAMPLES).map(|k| Stamp::from_nanos(EPOCH + k * SPACING)).collect();
    let values = (0..SAMPLES).map(|k| k as f64).collect();
    Run { name: "counted".into(), displacement_m: Trace { stamps, values }, ..Run::default() }
}

/// Another node on the domain, which controls the player and receives what it plays.
struct Peer {
    ros: Ros,
    displacement: Subscription<Displacement>,
    clock: Subscription<Clock>,
    /// Without these subscriptions the player would wait for a node.
    _others: (Subscription<Force>, Subscription<CoilCurrent>),
    pause: ClientOf<Pause>,
    resume: ClientOf<Resume>,
    toggle_paused: ClientOf<TogglePaused>,
    is_paused: ClientOf<IsPaused>,
    get_rate: ClientOf<GetRate>,
    set_rate: ClientOf<SetRate>,
    play_next: ClientOf<PlayNext>,
    burst: ClientOf<Burst>,
    seek: ClientOf<Seek>,
}

impl Peer {
    fn new(config: &Config) -> Self {
        let mut ros =
            Ros::start(config, &RosArgs::default(), NodeOptions::new(), "peer").expect("a peer starts");
        fn client<S: Service + 'static>(ros: &mut Ros, name: &str) -> ClientOf<S> {
            ros.client::<S>(&format!("/front/mr_damper_replay/{name}")).expect("a client")
        }
        Self {
            displacement: ros.subscribe("/lvdt/x").expect("a topic"),
            clock: ros.subscribe("/clock").expect("a topic"),
            _others: (
                ros.subscribe("/front/measured_force").expect("a topic"),
                ros.subscribe("/front/coil_current").expect("a topic"),
            ),
            pause: client::<Pause>(&mut ros, "pause"),
            resume: client::<Resume>(&mut ros, "resume"),
            toggle_paused: client::<TogglePaused>(&mut ros, "toggle_paused"),
            is_paused: client::<IsPaused>(&mut ros, "is_paused"),
            get_rate: client::<GetRate>(&mut ros, "get_rate"),
            set_rate: client::<SetRate>(&mut ros, "set_rate"),
            play_next: client::<PlayNext>(&mut ros, "play_next"),
            burst: client::<Burst>(&mut ros, "burst"),
            seek: client::<Seek>(&mut ros, "seek"),
            ros,
        }
    }

    /// Waits for all services: a first call may be lost before both ends have discovered each other.
    fn wait_for_services(&self) {
        let ros = &self.ros;
        wait_until("all services", || {
            ros.reaches(&self.pause)
                && ros.reaches(&self.resume)
                && ros.reaches(&self.toggle_paused)
                && ros.reaches(&self.is_paused)
                && ros.reaches(&self.get_rate)
                && ros.reaches(&self.set_rate)
                && ros.reaches(&self.play_next)
                && ros.reaches(&self.burst)
                && ros.reaches(&self.seek)
        });
    }

    /// The answer to a request. A first call may take three seconds.
    fn call<S: Service>(&self, client: &ClientOf<S>, request: S::Request) -> S::Response {
        answer::<S>(client, request)
    }

    fn is_paused(&self) -> bool {
        self.call::<IsPaused>(&self.is_paused, IsPausedRequest::default()).paused
    }

    fn rate(&self) -> f64 {
        self.call::<GetRate>(&self.get_rate, GetRateRequest::default()).rate
    }

    fn set_rate(&self, rate: f64) -> bool {
        self.call::<SetRate>(&self.set_rate, SetRateRequest { rate }).success
    }

    fn play_next(&self) -> bool {
        self.call::<PlayNext>(&self.play_next, PlayNextRequest::default()).success
    }

    fn burst(&self, num_messages: u64) -> u64 {
        self.call::<Burst>(&self.burst, BurstRequest { num_messages }).actually_burst
    }

    fn seek(&self, nanos: i64) -> bool {
        let time = Time::from_nanos(nanos).expect("in range");
        self.call::<Seek>(&self.seek, SeekRequest { time }).success
    }

    /// The received displacements, once none has arrived for 200 ms.
    fn heard(&self) -> Vec<f64> {
        let mut all = Vec::new();
        let mut last = Instant::now();
        while last.elapsed() < Duration::from_millis(200) {
            while let Some((message, _)) = self.displacement.take().expect("readable") {
                assert_eq!(
                    message.header.stamp.as_nanos(),
                    EPOCH + message.displacement as i64 * SPACING,
                    "with a clock, stamps come from the bag"
                );
                all.push(message.displacement);
                last = Instant::now();
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        all
    }

    /// The received times on /clock, in samples.
    fn times(&self) -> Vec<f64> {
        let mut all = Vec::new();
        while let Some((message, _)) = self.clock.take().expect("readable") {
            all.push((message.clock.as_nanos() - EPOCH) as f64 / SPACING as f64);
        }
        all
    }

    fn stop(self) {
        let Self { ros, .. } = self;
        ros.stop();
    }
}

fn numbers(from: i64, to: i64) -> Vec<f64> {
    (from..=to).map(|k| k as f64).collect()
}

#[test]
fn the_services_of_ros2_bag_play_work() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let config = Config { domain_id: domain.id(), ..Config::default() };
    let rule = "displacement:=/lvdt/x".to_owned();
    let args =
        RosArgs::in_namespace("/front").with_topics_renamed(&[rule], &Player::TOPICS).expect("a topic");
    let peer = Peer::new(&config);
    let mut player = Player::start(&config, &args, true).expect("a player starts");
    player.offer_services(&args).expect("services");
    player.control().pause();
    let (run, interrupt) = (run(), Interrupt::manual());
    let played = std::thread::scope(|threads| {
        let _ended = Ended(interrupt.flag());
        let playing = threads.spawn(|| {
            assert!(player.wait_for_listener(Duration::from_secs(20), &interrupt), "the peer listens");
            let options =
                PlaybackOptions { clock: true, clock_hz: Some(100.0), ..PlaybackOptions::default() };
            let mut played = Played::default();
            player.play(&run, &options, &mut played, &interrupt, None, &|_| {});
            played
        });
        peer.wait_for_services();
        wait_until("the player plays", || peer.burst(1) > 0);
        assert_eq!(peer.heard(), [0.0], "one message");
        assert!(peer.is_paused());

        assert!(peer.play_next());
        assert_eq!(peer.burst(5), 5);
        assert_eq!(peer.heard(), numbers(1, 6), "while paused, the player plays only what is requested");

        peer.times();
        std::thread::sleep(Duration::from_millis(300));
        let times = peer.times();
        assert!((15..=45).contains(&times.len()), "{} times in 300 ms at 100 Hz", times.len());
        assert!(times.iter().all(|&time| time == 6.0), "while paused, /clock does not advance: {times:?}");

        assert!(
            !peer.seek(EPOCH - 1) && !peer.seek(EPOCH + SAMPLES * SPACING),
            "a seek outside the bag is refused"
        );
        assert!(peer.seek(EPOCH + 200 * SPACING - 1), "between two samples");
        assert!(peer.play_next() && peer.heard() == [200.0], "playback continues at the next sample");
        assert!(peer.seek(EPOCH + 100 * SPACING), "back");
        assert!(peer.play_next() && peer.heard() == [100.0]);

        assert_eq!(peer.rate(), 1.0);
        assert!(peer.set_rate(0.5));
        for bad in [0.0, -1.0, f64::NAN] {
            assert!(!peer.set_rate(bad), "{bad}");
        }
        assert_eq!(peer.rate(), 0.5);
        peer.times();
        peer.call::<Resume>(&peer.resume, ResumeRequest::default());
        assert!(!peer.play_next() && peer.burst(3) == 0, "play_next and burst work only while paused");
        let start = Instant::now();
        std::thread::sleep(Duration::from_millis(1000));
        peer.call::<Pause>(&peer.pause, PauseRequest::default());
        let most = start.elapsed().as_secs_f64() * 50.0 + 15.0;
        let heard = peer.heard();
        assert_eq!(heard, numbers(101, 100 + heard.len() as i64), "in order, without a gap");
        assert!(heard.len() >= 45 && heard.len() as f64 <= most, "{} samples at 50 per second", heard.len());
        let times = peer.times();
        assert!(times.is_sorted() && times.len() >= 60, "{times:?}");

        peer.call::<TogglePaused>(&peer.toggle_paused, TogglePausedRequest::default());
        assert!(!peer.is_paused());
        peer.call::<TogglePaused>(&peer.toggle_paused, TogglePausedRequest::default());
        assert!(peer.is_paused());
        let before = peer.heard();
        let next = before.last().map_or(101 + heard.len() as i64, |last| *last as i64 + 1);

        // Plays all remaining samples, which ends the run.
        let left = (SAMPLES - next) as u64;
        assert_eq!(peer.burst(0), left);
        assert_eq!(peer.heard(), numbers(next, SAMPLES - 1));
        let played = playing.join().expect("no panic");
        assert!(!peer.seek(EPOCH) && !peer.play_next(), "after the run, seek and play_next are refused");
        played
    });
    assert_eq!(played.failed, 0);
    player.stop();
    peer.stop();
}

#[test]
fn without_a_clock_stamps_are_current_and_keep_their_spacing() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let config = Config { domain_id: domain.id(), ..Config::default() };
    let peer = Peer::new(&config);
    let rule = "displacement:=/lvdt/x".to_owned();
    let args =
        RosArgs::in_namespace("/front").with_topics_renamed(&[rule], &Player::TOPICS).expect("a topic");
    let player = Player::start(&config, &args, false).expect("a player starts");
    let interrupt = Interrupt::manual();
    assert!(player.wait_for_listener(Duration::from_secs(20), &interrupt), "the peer listens");
    let mut run = run();
    let trace = |value| Trace { stamps: vec![Stamp::from_nanos(EPOCH)], values: vec![value] };
    run.drive = Some((DriveKind::CoilCurrent, trace(1.0)));
    // Two rounds from 5.5 s on, as with `--loop`.
    let options = PlaybackOptions { start: 5.5, ..PlaybackOptions::default() };
    let mut played = Played::default();
    let before = mr_damper_base::clock::system_now().nanos();
    for _ in 0..2 {
        player.play(&run, &options, &mut played, &interrupt, None, &|_| {});
    }
    let mut stamps = Vec::new();
    let deadline = Instant::now() + Duration::from_secs(5);
    while stamps.len() < 100 && Instant::now() < deadline {
        while let Some((message, _)) = peer.displacement.take().expect("readable") {
            stamps.push((message.header.stamp.as_nanos(), message.displacement));
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    assert_eq!((played.samples, played.failed), (100, 0));
    let values: Vec<f64> = stamps.iter().map(|(_, value)| *value).collect();
    assert_eq!(values, [numbers(550, 599), numbers(550, 599)].concat());
    assert!(stamps[0].0 >= before, "the first stamp is the current time");
    for (round, stamps) in stamps.chunks(50).enumerate() {
        assert!(stamps.windows(2).all(|pair| pair[1].0 - pair[0].0 == SPACING), "round {round}");
    }
    assert!(stamps[50].0 > stamps[49].0, "the second round has later stamps than the first");
    player.stop();
    peer.stop();
}
