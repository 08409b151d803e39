//! L6: experiments of many runs: which, how each ended, what that says. RT: no.
//!
//! | file | what |
//! |---|---|
//! | [`plan`] | a file of `config/experiments/` → runs: axes × seeds, each a configuration |
//! | [`trial_run`] | one run in lockstep → one [`trial_run::RunRecord`] |
//! | [`ledger`] | records appended run by run: resumable, in shards |
//! | [`campaign`] | what is still to do, on some threads |
//! | [`statistics`] | success rates, steps to a fall, with their intervals |
//! | [`results`] | `results.json` |
//! | [`draw`] | the same for the page of [`crate::report`] |

pub mod campaign;
pub mod draw;
pub mod ledger;
pub mod plan;
pub mod results;
pub mod statistics;
pub mod trial_run;
