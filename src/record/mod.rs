//! L4: recordings. MCAP files that Foxglove and PlotJuggler read, and that replay to the bit. RT: no.
//!
//! - [`stream`]: a tick as messages and back; [`cdr`], [`schema`]: their bytes and descriptions.
//! - [`recorder`]: queue and writer thread; [`log_file`]: one file; [`storage`]: the disk, replaceable in tests.
//! - [`scan`]: records of a file, also of a torn one; [`reader`]: ticks again.
//! - [`live`]: the same messages over a socket to whoever reads along; [`json`]: as text.
//! - [`replay`]: the same inputs through the tick once more, compared bit by bit; [`inspect`]: what is in a file.

pub mod cdr;
pub mod inspect;
pub mod json;
pub mod live;
pub mod log_file;
pub mod reader;
pub mod recorder;
pub mod replay;
pub mod scan;
pub mod schema;
pub mod storage;
pub mod stream;

pub use reader::{ReadError, Reader};
pub use recorder::{RecordError, Recorder};

#[cfg(test)]
mod disaster;
