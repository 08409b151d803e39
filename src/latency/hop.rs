//! Hand-over through our channel against raw iceoryx2 with the same payload: publish and receive in one thread, so that
//! no wake-up hides the difference. RT: no.

use std::hint::black_box;
use std::time::Instant;

use iceoryx2::prelude::{NodeBuilder, ZeroCopySend, ipc};

use super::window::{Paired, Window};
use crate::channel::port::Endpoint;
use crate::channel::topic::Topic;
use crate::msg::{BusFrame, Element, TickRecord};

/// A channel that does not open.
#[derive(Debug, thiserror::Error)]
#[error("channel hop: {0}")]
pub struct HopError(String);

fn fail(e: impl std::fmt::Display) -> HopError {
    HopError(e.to_string())
}

/// Windows of hops of one frame, ours and theirs in turn.
///
/// # Errors
/// If shared memory cannot be used.
pub fn frame(windows: usize, hops: usize) -> Result<Paired, HopError> {
    measure::<BusFrame>("bench-frame", windows, hops)
}

/// Windows of hops of a whole tick, ours and theirs in turn.
///
/// # Errors
/// If shared memory cannot be used.
pub fn tick_record(windows: usize, hops: usize) -> Result<Paired, HopError> {
    measure::<TickRecord>("bench-tick", windows, hops)
}

fn measure<T>(name: &'static str, windows: usize, hops: usize) -> Result<Paired, HopError>
where
    T: Element + ZeroCopySend + std::fmt::Debug + Default + 'static,
{
    let robot = format!("bench-{}", std::process::id());
    let (here, there) = (Endpoint::join(&robot).map_err(fail)?, Endpoint::join(&robot).map_err(fail)?);
    let topic = Topic::<T>::new(name, 8, 1);
    let mut subscriber = here.subscriber(&topic).map_err(fail)?;
    let mut publisher = there.publisher(&topic).map_err(fail)?;

    let node = NodeBuilder::new().create::<ipc::Service>().map_err(fail)?;
    let service = node
        .service_builder(&format!("{robot}/{name}/raw").as_str().try_into().map_err(fail)?)
        .publish_subscribe::<T>()
        .subscriber_max_buffer_size(8)
        .open_or_create()
        .map_err(fail)?;
    let raw_subscriber = service.subscriber_builder().create().map_err(fail)?;
    let raw_publisher = service.publisher_builder().create().map_err(fail)?;

    let message = T::default();
    let mut pair = Paired::default();
    for _ in 0..windows {
        pair.ours.push(timed(hops, || {
            publisher.publish(black_box(&message));
            black_box(subscriber.receive());
        }));
        pair.theirs.push(timed(hops, || {
            if let Ok(sample) = raw_publisher.loan_uninit() {
                black_box(sample.write_payload(*black_box(&message)).send().is_ok());
            }
            // As much as ours does: the message is copied out before its slot is given back.
            black_box(raw_subscriber.receive().ok().flatten().map(|sample| *sample));
        }));
    }
    Ok(pair)
}

/// Time of each of `hops` calls, us.
fn timed(hops: usize, mut hop: impl FnMut()) -> Window {
    for _ in 0..hops / 10 {
        hop();
    }
    let samples = (0..hops).map(|_| {
        let start = Instant::now();
        hop();
        start.elapsed().as_secs_f64() * 1e6
    });
    Window::new(samples.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_hop_of_both_rivals_is_timed() {
        let pair = frame(2, 50).unwrap();
        assert_eq!(pair.ours.iter().chain(&pair.theirs).map(Window::len).collect::<Vec<_>>(), [50; 4]);
        assert!(pair.ratio(50.0) > 0.0);
    }
}
