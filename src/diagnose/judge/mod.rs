//! The judge: is model A better than model B, does an effect stand in the answer, what is the verdict called.
//!
//! Functions of fitted models and numbers; what must be fitted to decide, [`robustness`](crate::diagnose::robustness) fits. Who
//! searches (`stepwise`, `round`, `exchange`, `pairwise_exchange`, `converge_rivals`) asks and decides nothing.
//!
//! | file | question |
//! |---|---|
//! | [`numbers`] | every number that decides, with where it comes from |
//! | [`criterion`] | how much better is one model, and from when on does that count? |
//! | [`accept`] | is a candidate accepted as a further effect? |
//! | [`flexibility`] | or does it fit a piece of anything? |
//! | [`simplicity`] | which of two that explain as much comes first? |
//! | [`exchange`] | does another effect take its place, does it stay at all? |
//! | [`estimates`] | how sure is each number, what is not determined? |
//! | [`evidence`] | what would one evidence say in place of the rules? (in shadow) |
//! | [`continuity`] | are its hidden states those of one machine? |
//! | [`confirmation`] | does it hold where it was not fitted? |
//! | [`credible_set`] | what do the data not tell apart from it? |
//! | [`nameless`] | does a force without a name say more than all that was named? |
//! | [`pooling`] | are all recordings of one machine, does every channel follow? |
//! | [`rejected`] | why is it not one of the others? |
//! | [`verdict`] | what is the answer called? |
//!
//! RT: no.

pub mod accept;
pub mod confirmation;
pub mod continuity;
pub mod credible_set;
pub mod criterion;
pub mod estimates;
pub mod evidence;
pub mod exchange;
pub mod flexibility;
pub mod nameless;
pub mod numbers;
pub mod pooling;
pub mod rejected;
pub mod simplicity;
pub mod verdict;
pub(crate) mod worked;
