//! L7: what physics is missing in a simulation, from recordings (diagnosis contract, schema 1).
//!
//! # The walk
//! 1. [`pipeline`]: the base fit ([`base_model`], [`base_fit`]), outliers left out, the noise that it leaves ([`likelihood`]), and
//!    the steps and the friction of the simulator that made the recordings, if one did ([`numerics`]). These are asked
//!    again beside the first effect, and beside all that was selected; if others are likelier there, the search starts anew with them,
//!    and each effect that was found stands among its first candidates. If they gain no more than chance beside what was found, the
//!    search starts anew without them.
//!    Where the walk to step 5 names nothing that holds, pieces of the windows are asked ([`horizon`]; where what it names explains most of
//!    the misfit, for chaotic motion only): the shortest for the base and the numerics, longer ones for effects, which stand among the first candidates of a
//!    second walk on whole windows. Where they show what was named already, and no better, the first walk stands.
//! 2. [`search`], [`stepwise`]: forward selection. In a [`round`] every candidate of the [`library`] ([`candidates`],
//!    [`initial_guesses`]) is scored by what one linear step promises ([`screen`], [`score_test`]); the best are fitted in full,
//!    jointly with all base parameters. Where a number of the base is at its bound, or feet land where it does not follow, the first
//!    effect is sought from the numbers as given, too.
//!    The first that is accepted, and stays off its bounds when it is fitted to the end, is added; then the next round. There
//!    the [`runners_up`] of the last one are fitted whatever they promise, and alone where there is no time for more.
//!    Laws that stand at a joint ([`laws`](library::laws)) are exchanged for one whose force is nearest to theirs ([`law_exchange`]).
//! 3. [`pairwise_exchange`], [`exchange`], [`converge_rivals`]: neighbours of the selected model, each kept if better; what looks like an
//!    effect is fitted anew in its place.
//! 4. [`nameless`], [`residual_force`]: does a force without a name ([`force_patterns`]) say more ([`free_curve`], [`change_point`])? Are all recordings of one
//!    machine ([`pooling_test`])?
//! 5. [`robustness`], [`interest`]: what is too small to matter, not told from nothing, at the edge of the range in which it was
//!    sought, explained by instants within their rows ([`instants`]), or does not replicate where it was not fitted ([`held_out`]), is seen
//!    and not named.
//!    Where one is taken out that is not told from nothing, or at the edge, and others stay, the search goes on from these.
//!    Where recordings kept back contradict what stays, effects that look like it are asked in its place ([`kept_back_exchange`]).
//! 6. [`validation`]: free runs on recordings that were never fitted; [`explain`]: [`answer_sets`], [`localise`], [`laws`], [`sentence`],
//!    [`tables`], [`headline`]: the answer in numbers, curves and words.
//!
//! # The rooms
//! In layers, each of which knows only those before it (`tests/architecture.rs`):
//!
//! | room | what it does |
//! |---|---|
//! | [`screen`] | makes the base linear and tests signals against what it leaves |
//! | [`library`] | what may be missing, and what a fit with it led to |
//! | [`robustness`] | measures what holds elsewhere, or beside what no recording tells; decides nothing |
//! | [`judge`] | decides, by functions of fitted models and those measures |
//! | [`search`] | finds models that fit better; decides nothing |
//! | [`nameless`] | what no effect of the library says |
//! | [`explain`] | the answer in sets, numbers and curves |
//! | [`pipeline`] | the walk: from a case to its answer |
//!
//! In no room stand [`base_model`] and [`sentence`], which know none of them, [`supposed`] beside [`nameless`], [`input_checks`]
//! beside [`explain`], and [`identification`], which is the walk of `compass identify`.
//!
//! # The rules
//! All that decides is in [`judge`], its numbers in [`judge::numbers`]. In twice the natural logarithm of the likelihood:
//!
//! | question | rule | where |
//! |---|---|---|
//! | is anything missing? | gain over max(60, .02 N) + k ln N, in every part of the recordings | [`judge::criterion`], [`judge::accept`] |
//! | is it that effect? | no bound hit, states that go on from window to window, .25 of the gain on recordings left out, or of what it promises on recordings kept back | [`judge::accept`], [`judge::continuity`] |
//! | or a piece of anything? | pushes and jumps are not taken beside smooth misfit, nor is a ripple on a rail, unless recordings kept back bear it out; less than half a wave is no ripple | [`judge::flexibility`] |
//! | a further effect? | 2 % of what those before it gained, 15 % where smooth misfit stays | [`judge::accept`] |
//! | which of two? | 10 ahead, and k ln N for the k numbers that it has more; the simpler one with .95 of the gain; of those that fit as well the one that recordings kept back bear out | [`judge::exchange`], [`judge::simplicity`], [`kept_back_exchange`] |
//! | what stands beside it? | within two deviations, or within the error of form: 2 and 15 % as above, at most 60 | [`judge::credible_set`] |
//! | nothing of the library? | a free force .25 ahead of all that was listed, that predicts recordings kept back better than what was listed; over time, only where these do not bear out what was listed | [`judge::nameless`], [`residual_force`] |
//! | or is it only late? | the same gain beside angles, rates, and forces that go with rates, that are all off by up to an eighth of a row, and touchdowns that take up to 10 ms | [`judge::accept`], [`instants`], [`touchdowns`] |
//! | does it hold where it was not fitted? | .25 of what it promises, if it promises more than chance: on recordings kept back, as it was found or else within its intervals, beside other numbers that are fitted there with it and without it; an event in its own, cut into windows that show it, where it leaves at most .25 of the squares above noise; a force without a name whatever it promises | [`judge::confirmation`], [`held_out`] |
//! | does it matter? | .08 of the misfit, and a strength whose 95 % interval does not reach nothing | [`judge::verdict`], [`interest`] |
//!
//! Beside these rules stands one evidence, [`judge::evidence`]: a likelihood whose form is not exact, less what its numbers and the
//! search cost. It is computed at every acceptance, exchange and membership, written by `compass diagnose --trace FILE`, and
//! decides nothing. `docs/diagnosis.md` has the table of where the two disagree.
//!
//! # Intervals
//! The deviation of a number is what the residual shows, with the scatter of its blocks ([`crate::identify::covariance`]). Its 95 %
//! interval holds besides what no residual shows: the instants of commands and readings, known to a row
//! ([`crate::identify::sampling`]), and that no form is exact ([`tables`]).
//!
//! # Words
//! - *Base*: the rig as given with its free numbers fitted. *Candidate*: an effect at a place, with starts and bounds.
//! - *Gain*: rise of twice the log-likelihood over the model before, both under the noise that the better one leaves.
//! - *Misfit*: a residual that is smooth, not noise: its innovations are small beside it.
//! - *Window*: a free run that starts from a fitted state. *Inner states*: those of a spring, a bristle, a filter, beside
//!   coordinates and rates.
//! - *Event*: an effect that acts at one instant of one recording (a push, a jump of an encoder).
//! - *Twins*: effects that no motion tells apart. *Limit*: an effect that another one contains with one number less.
//! - *Score test*: gain of adding a signal, linear around the base, with base parameters and window states following.
//! - *LTV window*: the base's run made linear, row by row. *Continuity*: inner states of a window start where the one before ended.
//! - *Leave one recording out*: base and candidate fitted to the others, compared on the one left out; of a single recording, a stretch of
//!   its windows.
//!
//! RT: no.
//!
//! [`answer_sets`]: explain::answer_sets
//! [`base_fit`]: crate::identify::base_fit
//! [`candidates`]: library::candidates
//! [`change_point`]: nameless::change_point
//! [`converge_rivals`]: search::converge_rivals
//! [`exchange`]: search::exchange
//! [`force_patterns`]: nameless::force_patterns
//! [`free_curve`]: nameless::free_curve
//! [`headline`]: explain::headline
//! [`held_out`]: robustness::held_out
//! [`horizon`]: crate::identify::horizon
//! [`initial_guesses`]: library::initial_guesses
//! [`instants`]: robustness::instants
//! [`interest`]: explain::interest
//! [`kept_back_exchange`]: search::kept_back_exchange
//! [`laws`]: explain::laws
//! [`law_exchange`]: search::law_exchange
//! [`likelihood`]: crate::identify::likelihood
//! [`localise`]: explain::localise
//! [`numerics`]: search::numerics
//! [`pairwise_exchange`]: search::pairwise_exchange
//! [`pooling_test`]: nameless::pooling_test
//! [`residual_force`]: nameless::residual_force
//! [`round`]: search::round
//! [`runners_up`]: search::runners_up
//! [`score_test`]: screen::score_test
//! [`stepwise`]: search::stepwise
//! [`tables`]: explain::tables
//! [`touchdowns`]: robustness::touchdowns
//! [`validation`]: crate::identify::validation

pub mod base_model;
pub mod explain;
pub mod identification;
pub mod input_checks;
#[cfg(test)]
mod input_tests;
pub mod judge;
pub mod library;
pub mod nameless;
pub mod pipeline;
pub mod robustness;
pub mod screen;
pub mod search;
pub mod sentence;
pub mod supposed;
