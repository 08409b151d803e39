use super::*;
use proptest::prelude::*;

const V3: Version = Version { major: 3, minor: 1 };
const V4: Version = Version { major: 4, minor: 1 };

fn body(id: u32, tracked: bool) -> Body {
    Body { id, position_m: [1.0, 2.0, -0.5], quaternion: [0.0, 0.0, 0.6, 0.8], tracked }
}

fn body_bytes(body: &Body) -> Vec<u8> {
    let mut out = body.id.to_le_bytes().to_vec();
    body.position_m.iter().chain(&body.quaternion).for_each(|x| out.extend(x.to_le_bytes()));
    out.extend(0.0003_f32.to_le_bytes());
    out.extend((u16::from(body.tracked)).to_le_bytes());
    out
}

/// A section of these items.
fn section(version: Version, items: &[Vec<u8>]) -> Vec<u8> {
    let content = items.concat();
    let length = if version == V4 { u32::try_from(content.len()).unwrap().to_le_bytes().to_vec() } else { Vec::new() };
    [u32::try_from(items.len()).unwrap().to_le_bytes().to_vec(), length, content].concat()
}

/// A frame with something in each section.
fn frame_bytes(version: Version, number: u32, bodies: &[Body]) -> Vec<u8> {
    let all: Vec<Vec<u8>> = bodies.iter().map(body_bytes).collect();
    let set = [b"robot\0".to_vec(), 2_u32.to_le_bytes().to_vec(), vec![0; 24]].concat();
    let skeleton = [7_u32.to_le_bytes().to_vec(), 1_u32.to_le_bytes().to_vec(), all[0].clone()].concat();
    let asset = [skeleton.clone(), 1_u32.to_le_bytes().to_vec(), vec![0; 26]].concat();
    let plate = [1_u32.to_le_bytes(), 1_u32.to_le_bytes(), 2_u32.to_le_bytes(), [0; 4], [0; 4]].concat();
    let mut payload = number.to_le_bytes().to_vec();
    payload.extend(section(version, &[set]));
    payload.extend(section(version, &[vec![0; 12], vec![0; 12]]));
    payload.extend(section(version, &all));
    payload.extend(section(version, &[skeleton]));
    if version == V4 {
        payload.extend(section(version, &[asset]));
    }
    payload.extend(section(version, &[vec![0; 26]]));
    payload.extend(section(version, std::slice::from_ref(&plate)));
    payload.extend(section(version, &[plate]));
    payload.extend([0; 16]);
    payload.extend(123_456_789_u64.to_le_bytes());
    payload.extend([0; 16]);
    payload.extend(2_u16.to_le_bytes());
    payload.extend([0; 4]);
    message(7, &payload)
}

fn message(id: u16, payload: &[u8]) -> Vec<u8> {
    [&id.to_le_bytes()[..], &u16::try_from(payload.len()).unwrap().to_le_bytes(), payload].concat()
}

fn bodies_of(datagram: &[u8], version: Version) -> (Result<Message, Damage>, Vec<Body>) {
    let mut bodies = Vec::new();
    (read(datagram, version, |body| bodies.push(body)), bodies)
}

#[test]
fn requests_are_those_of_the_reference() {
    assert_eq!(CONNECT, *b"\x00\x00\x05\x00Ping\x00");
    assert_eq!(KEEP_ALIVE, [10, 0, 0, 0]);
}

#[test]
fn bodies_of_a_full_frame_are_read_in_both_versions() {
    for version in [V3, V4] {
        let sent = [body(1, true), body(2, false)];
        let (message, bodies) = bodies_of(&frame_bytes(version, 42, &sent), version);
        let head = FrameHead { number: 42, exposed_ticks: 123_456_789, models_changed: true };
        assert_eq!(message, Ok(Message::Frame(head)), "{version:?}");
        assert_eq!(bodies, sent, "those of skeletons and assets are others");
    }
}

#[test]
fn a_section_that_grew_is_skipped_by_its_length() {
    let mut datagram = frame_bytes(V4, 42, &[body(1, true)]);
    // The marker sets' section: count at 8, length at 12, content from 16 on. Three bytes more than we know.
    let length = u32::from_le_bytes(padded(&datagram[12..16]));
    datagram[12..16].copy_from_slice(&(length + 3).to_le_bytes());
    let end = 16 + length as usize;
    datagram.splice(end..end, [1, 2, 3]);
    let total = u16::try_from(datagram.len() - 4).unwrap();
    datagram[2..4].copy_from_slice(&total.to_le_bytes());
    let (message, bodies) = bodies_of(&datagram, V4);
    assert!(matches!(message, Ok(Message::Frame(_))), "{message:?}");
    assert_eq!(bodies, [body(1, true)]);
}

#[test]
fn a_frame_read_as_another_version_is_damage_and_not_a_pose() {
    let (three, four) = (frame_bytes(V3, 1, &[body(1, true)]), frame_bytes(V4, 1, &[body(1, true)]));
    assert!(bodies_of(&three, V4).0.is_err() && bodies_of(&four, V3).0.is_err());
}

#[test]
fn every_truncation_is_damage() {
    for version in [V3, V4] {
        let whole = frame_bytes(version, 1, &[body(1, true)]);
        for end in 0..whole.len() {
            assert!(bodies_of(&whole[..end], version).0.is_err(), "{end} of {}", whole.len());
        }
        // The same with a length that fits.
        for end in 4..whole.len() {
            let cut = message(7, &whole[4..end]);
            assert!(bodies_of(&cut, version).0.is_err(), "{end} of {}", whole.len());
        }
    }
}

#[test]
fn the_server_tells_its_version_and_clock() {
    let mut payload = vec![0; 256];
    payload[..6].copy_from_slice(b"Motive");
    payload.extend([3, 0, 0, 0, 4, 1, 0, 0]);
    payload.extend(10_000_000_u64.to_le_bytes());
    payload.extend([0xE7, 5, 1, 239, 255, 42, 99]);
    let (message, _) = bodies_of(&message(1, &payload), V3);
    assert_eq!(message, Ok(Message::Server(ServerInfo { version: V4, clock_hz: 10_000_000 })));
}

proptest! {
    #[test]
    fn foreign_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300), four: bool, as_frame: bool) {
        let version = if four { V4 } else { V3 };
        let datagram = if as_frame { message(7, &bytes) } else { bytes };
        bodies_of(&datagram, version).0.ok();
    }

    #[test]
    fn a_changed_byte_never_panics(at in 0_usize..400, byte: u8, four: bool) {
        let version = if four { V4 } else { V3 };
        let mut datagram = frame_bytes(version, 1, &[body(1, true), body(2, true)]);
        let at = at % datagram.len();
        datagram[at] = byte;
        bodies_of(&datagram, version).0.ok();
    }
}
