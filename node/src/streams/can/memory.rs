//! A bus in memory, for tests: frames and faults go in, and sent frames come out.

use super::{Arrival, BusFault, CanBus, CanError, Frame, FrameReceiver, FrameSender, SendFault};
use mr_damper_base::clock::system_now;
use mr_damper_model::sample::Stamp;
use mr_damper_runs::bus::{CanId, FrameFilter};
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

#[derive(Default)]
struct State {
    arrivals: VecDeque<Arrival>,
    sent: Vec<Frame>,
    fault: Option<SendFault>,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    came: Condvar,
}

impl Shared {
    /// Locks the state. A panic of the last holder does no harm: queues are changed as a whole.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A bus with one node on it. Clones are the same bus.
#[derive(Clone, Default)]
pub struct MemoryBus(Arc<Shared>);

impl MemoryBus {
    /// Puts a frame of another node onto the bus.
    pub fn put(&self, frame: Frame) {
        self.arrive(Arrival::Frame(frame));
    }

    /// Lets the bus have a fault.
    pub fn fault(&self, fault: BusFault) {
        self.arrive(Arrival::Fault(fault));
    }

    /// Refuses all frames that the node sends from now on; with `None`, accepts them again.
    pub fn refuse(&self, fault: Option<SendFault>) {
        self.0.lock().fault = fault;
    }

    /// The frames that the node has sent since the last call. Their stamps are the times of sending.
    #[must_use]
    pub fn sent(&self) -> Vec<Frame> {
        std::mem::take(&mut self.0.lock().sent)
    }

    fn arrive(&self, arrival: Arrival) {
        self.0.lock().arrivals.push_back(arrival);
        self.0.came.notify_one();
    }
}

impl CanBus for MemoryBus {
    /// The receiver of a bus in memory gets all frames, so that a test sees how others are treated.
    fn receiver(&self, _wanted: &[FrameFilter]) -> Result<Box<dyn FrameReceiver>, CanError> {
        Ok(Box::new(self.clone()))
    }

    fn sender(&self) -> Result<Box<dyn FrameSender>, CanError> {
        Ok(Box::new(self.clone()))
    }
}

impl FrameReceiver for MemoryBus {
    fn receive(&mut self, timeout: Duration) -> Option<Arrival> {
        let end = Instant::now() + timeout;
        let mut state = self.0.lock();
        loop {
            if let Some(arrival) = state.arrivals.pop_front() {
                return Some(arrival);
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return None;
            }
            state = self.0.came.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl FrameSender for MemoryBus {
    fn send(&mut self, id: CanId, data: &[u8]) -> Result<(), SendFault> {
        let stamp: Stamp = system_now();
        let mut state = self.0.lock();
        if let Some(fault) = state.fault {
            return Err(fault);
        }
        state.sent.push(Frame::new(id, stamp, data).ok_or(SendFault::Failed)?);
        Ok(())
    }
}
