//! Datagrams between a remote hand and the robot. All numbers are little endian; each ends with the first 16 bytes of the
//! HMAC-SHA256 over everything before. RT: yes, but nobody needs it there.
//!
//! | datagram | from | after `CGR1` and its kind | key |
//! |---|---|---|---|
//! | 1 hello | person | 16 bytes of chance | secret |
//! | 2 welcome | robot | the same 16, 16 of its own | secret |
//! | 3 state | person | its 16, u64 number, u32 its clock (us), u32 the robot's clock as last told (us), u32 us since then (`FFFFFFFF`: never), u8 held, u32 zeros confirmed, f64 hip angle of the newest (rad) | session |
//! | 5 state with stick | person | as 3, then f64 how far the stick is pushed (0 to 1) | session |
//! | 4 view | robot | the person's 16, u64 number, u32 its clock (us), u8 mode, u8 first fault, u64 what keeps it from arming, u32 faults | session |
//!
//! The session's key is the HMAC-SHA256 with the secret over `compass session`, the person's 16 bytes and the robot's.

use crate::base::bytes::{Short, padded};
use crate::msg::{FaultCode, Mode};
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;

/// First bytes of every datagram.
const MAGIC: [u8; 4] = *b"CGR1";
/// Bytes of a seal.
const SEAL: usize = 16;
/// Longest datagram.
pub const LONGEST: usize = 80;
/// No round trip is known yet.
pub const NEVER_US: u32 = u32::MAX;

/// Bytes of chance that name a session at one end.
pub type Nonce = [u8; 16];
/// A datagram.
pub type Datagram = Short<LONGEST>;

/// A key: the shared secret, or a session's.
#[derive(Clone)]
pub struct Key(Hmac<Sha256>);

impl std::fmt::Debug for Key {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Key")
    }
}

impl Key {
    /// From a secret of any length.
    ///
    /// HMAC takes keys of any length, so there is nothing that could fail.
    #[must_use]
    pub fn new(secret: &[u8]) -> Option<Self> {
        Hmac::new_from_slice(secret).ok().map(Self)
    }

    /// The key of the session of these two.
    #[must_use]
    pub fn of_session(&self, person: &Nonce, robot: &Nonce) -> Option<Self> {
        let mut mac = self.0.clone();
        mac.update(b"compass session");
        mac.update(person);
        mac.update(robot);
        Self::new(&mac.finalize().into_bytes())
    }

    /// Puts the seal under a datagram.
    fn seal(&self, datagram: &mut Datagram) {
        let mut mac = self.0.clone();
        mac.update(datagram.as_slice());
        let full: [u8; 32] = mac.finalize().into_bytes().into();
        datagram.put(&padded::<SEAL>(&full));
    }

    /// True if the seal is that of this key; takes as long for any wrong one.
    #[must_use]
    pub fn is_authentic(&self, datagram: &[u8]) -> bool {
        let Some((body, seal)) = datagram.split_last_chunk::<SEAL>() else { return false };
        let mut mac = self.0.clone();
        mac.update(body);
        mac.verify_truncated_left(seal).is_ok()
    }
}

/// How the switch is, as the person's end says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State {
    /// Counts states; both sendings of one have the same.
    pub number: u64,
    /// The person's clock, us; wraps.
    pub time_us: u32,
    /// The robot's clock as last told, us.
    pub echo_us: u32,
    /// Time since that was heard, us; [`NEVER_US`]: never.
    pub echo_age_us: u32,
    /// The switch is held.
    pub held: bool,
    /// Counts the zeros that the person confirmed.
    pub zeroings: u32,
    /// Hip angle at the newest, rad.
    pub zero_angle_rad: f64,
    /// How far the stick beside the switch is pushed, 0 to 1; none without a stick.
    pub stick: Option<f64>,
}

/// How the robot is: all that travels back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct View {
    /// Counts views.
    pub number: u64,
    /// The robot's clock, us; wraps.
    pub time_us: u32,
    /// Its mode.
    pub mode: Mode,
    /// The first fault since it was last cleared.
    pub first_fault: FaultCode,
    /// Why arming is not possible now: bit i is fault code i.
    pub arm_blockers: u64,
    /// Faults since start.
    pub faults: u32,
}

/// What a datagram says, before anybody has looked at its seal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Packet {
    /// A person's end wants a session.
    Hello(Nonce),
    /// The robot's number for it.
    Welcome(Nonce, Nonce),
    /// How the switch is.
    State(Nonce, State),
    /// How the robot is.
    View(Nonce, View),
}

impl Packet {
    /// As bytes, sealed.
    #[must_use]
    pub fn sealed(&self, key: &Key) -> Datagram {
        let mut out = Datagram::new(&MAGIC);
        match self {
            Self::Hello(person) => {
                out.put(&[1]);
                out.put(person);
            }
            Self::Welcome(person, robot) => {
                out.put(&[2]);
                out.put(person);
                out.put(robot);
            }
            Self::State(person, state) => {
                out.put(&[if state.stick.is_some() { 5 } else { 3 }]);
                out.put(person);
                out.put(&state.number.to_le_bytes());
                out.put(&state.time_us.to_le_bytes());
                out.put(&state.echo_us.to_le_bytes());
                out.put(&state.echo_age_us.to_le_bytes());
                out.put(&[u8::from(state.held)]);
                out.put(&state.zeroings.to_le_bytes());
                out.put(&state.zero_angle_rad.to_le_bytes());
                if let Some(share) = state.stick {
                    out.put(&share.to_le_bytes());
                }
            }
            Self::View(person, view) => {
                out.put(&[4]);
                out.put(person);
                out.put(&view.number.to_le_bytes());
                out.put(&view.time_us.to_le_bytes());
                out.put(&[view.mode as u8, view.first_fault as u8]);
                out.put(&view.arm_blockers.to_le_bytes());
                out.put(&view.faults.to_le_bytes());
            }
        }
        key.seal(&mut out);
        out
    }

    /// Reads a datagram; its seal is another matter. `None`: of another making, or a value that cannot be.
    #[must_use]
    pub fn parse(datagram: &[u8]) -> Option<Self> {
        let (body, _seal) = datagram.split_last_chunk::<SEAL>()?;
        let mut fields = Fields(body.strip_prefix(&MAGIC)?);
        let [kind] = fields.take()?;
        let person = fields.take()?;
        let packet = match kind {
            1 => Self::Hello(person),
            2 => Self::Welcome(person, fields.take()?),
            3 => Self::State(person, fields.state()?),
            5 => Self::State(person, fields.state_with_stick()?),
            4 => Self::View(person, fields.view()?),
            _ => return None,
        };
        fields.0.is_empty().then_some(packet)
    }
}

/// Bytes that are not read yet.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (field, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*field)
    }

    fn state(&mut self) -> Option<State> {
        let state = State {
            number: u64::from_le_bytes(self.take()?),
            time_us: u32::from_le_bytes(self.take()?),
            echo_us: u32::from_le_bytes(self.take()?),
            echo_age_us: u32::from_le_bytes(self.take()?),
            held: match self.take()? {
                [0] => false,
                [1] => true,
                _ => return None,
            },
            zeroings: u32::from_le_bytes(self.take()?),
            zero_angle_rad: f64::from_le_bytes(self.take()?),
            stick: None,
        };
        // NaN is no angle either.
        (state.zero_angle_rad.abs() <= std::f64::consts::PI).then_some(state)
    }

    fn state_with_stick(&mut self) -> Option<State> {
        let state = self.state()?;
        let share = f64::from_le_bytes(self.take()?);
        (0.0..=1.0).contains(&share).then_some(State { stick: Some(share), ..state })
    }

    fn view(&mut self) -> Option<View> {
        let (number, time_us) = (u64::from_le_bytes(self.take()?), u32::from_le_bytes(self.take()?));
        let [mode, first_fault] = self.take()?;
        Some(View {
            number,
            time_us,
            mode: Mode::from_u8(mode)?,
            first_fault: FaultCode::from_u8(first_fault)?,
            arm_blockers: u64::from_le_bytes(self.take()?),
            faults: u32::from_le_bytes(self.take()?),
        })
    }
}
