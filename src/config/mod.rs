//! L2: configuration. What a person typed (`raw`) becomes [`checked`]: valid by construction, units in names.
//!
//! Robot, real time, control and simulation are separate files in `config/`; the defaults are embedded.
//! RT: before arming only.

pub mod checked;
