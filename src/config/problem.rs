//! What is wrong with a configuration, told so that it can be put right: file, line, key, value, what is allowed.
//! RT: before arming only.

use std::fmt;

/// File of a problem that lies between keys, until the place of one of them is known.
pub(super) const ACROSS_KEYS: &str = "configuration";

/// One thing that is wrong, or suspicious.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// File as named by the user, `embedded robot.toml`, or `--set`.
    pub file: String,
    /// Line in it, from 1; 0 when the problem has no line.
    pub line: usize,
    /// Full key, such as `robot.hip.gear_ratio`.
    pub key: String,
    /// Value as typed, if there was one.
    pub value: Option<String>,
    /// What is wrong and what is allowed, with the unit.
    pub what: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file)?;
        if self.line > 0 {
            write!(f, ":{}", self.line)?;
        }
        if !self.key.is_empty() {
            write!(f, ": {}", self.key)?;
        }
        if let Some(value) = &self.value {
            write!(f, " = {value}")?;
        }
        write!(f, ": {}", self.what)
    }
}

/// Everything that is wrong with a configuration, all at once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Errors(pub Vec<Problem>);

impl fmt::Display for Errors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plural = if self.0.len() == 1 { "" } else { "s" };
        write!(f, "configuration has {} error{plural}", self.0.len())?;
        for problem in &self.0 {
            write!(f, "\n  {problem}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Errors {}
