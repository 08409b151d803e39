//! Every number that decides whether an effect exists, which one it is, or what the verdict is called.
//!
//! Each with where it comes from: *measured* (on which data), *argued* (from what), or *tuned* (on which case). Gains are in
//! twice the natural logarithm of a likelihood, "threshold" is [`super::criterion::detection_threshold`].
//! RT: no.

// Detection.

/// Least gain of a candidate over the base. *Measured:* a search over some 200 starts brings less than 30 on healthy cases with
/// exact noise; the double of it.
pub const LEAST_GAIN: f64 = 60.0;
/// The same per sample. *Measured:* rounding and solvers of other simulators bring up to .025 on healthy cases.
pub const LEAST_GAIN_PER_SAMPLE: f64 = 0.02;
/// Samples beyond which more of them make no form truer: where the two limits above meet. *Derived.*
pub const FORM_SAMPLES: f64 = LEAST_GAIN / LEAST_GAIN_PER_SAMPLE;
/// Prior odds that a kind of term is missing, for the evidence. *Derived:* two cases of three lack something, one of 33 kinds.
pub const TERM_ODDS: f64 = 2.0 / 3.0 / 33.0;
/// Twice the logarithm of the odds beyond which a model is out of Occam's window. *By definition:* 20 to 1 (Madigan and Raftery 1994).
pub const OCCAM_WINDOW: f64 = 5.991_464_547_107_98;
/// Part of the threshold below which the best promise of a linear step is not worth a round of fits. *Argued:* a step promises a
/// half at least of what a fit brings where the law is not bent.
pub const LEAST_PROMISE: f64 = 0.4;
/// Gain in thresholds from which a strength that shares its information with the base is believed all the same. *Argued.*
pub const BEYOND_DOUBT: f64 = 5.0;
/// Gain in thresholds that no healthy machine shows. *Measured:* theirs stay below a third of it.
pub const FAR_BEYOND_CHANCE: f64 = 2.0;
/// Standard deviations from nothing below which a strength is none. *By definition:* the 95 % interval reaches nothing.
pub const STRENGTH_DEVIATIONS: f64 = 1.96;
/// Relative distance to a bound at which a number was cut off rather than found. *Argued:* the last step of a fit.
pub const AT_BOUND: f64 = 0.01;
/// Lead over another model, in twice the log-likelihood, from which it is replaced. *Argued:* odds of 150 to 1.
pub const CLEAR_LEAD: f64 = 10.0;
/// Part of a candidate's gain that stays when it is taken out again, from which it was the fit that was improved, not the model.
/// *Argued:* more than half.
pub const NOT_ITS_OWN: f64 = 0.5;

// Error of form: no law of the library is exact, and a second effect must not live off what the first leaves.

/// Least gain of a further effect in parts of what those before it gained, where another one gains nearly as much. *Argued.*
pub const FURTHER: f64 = 0.04;
/// The same where nothing else gains nearly as much. *Argued.*
pub const FURTHER_ALONE: f64 = 0.02;
/// Part of a candidate's gain that counts as nearly as much. *Argued.*
pub const NEARLY: f64 = 0.6;
/// Least gain of a further effect in parts of those before it where smooth misfit stays. *Tuned* on a pendulum with gears, where a
/// ripple (.14) and a play (.06) came after the Coulomb friction that explains it.
pub const FURTHER_IN_MISFIT: f64 = 0.15;
/// Least gain per sample where smooth misfit stays. *Argued:* a tenth of the squares is the least that a user would notice.
pub const NOTICED_PER_SAMPLE: f64 = 0.1;
/// Periods of a ripple within the travel below which it is not told from another law of position, in smooth misfit. *Argued.*
pub const PERIODS_IN_MISFIT: f64 = 3.0;
/// The same where noise is left. *Argued:* half a wave is a parabola.
pub const PERIODS: f64 = 0.75;
/// Part of the gain of a ripple from which one of another order at the same joint leaves the order unresolved, beside what the two
/// waves share. *Argued.*
pub const UNRESOLVED: f64 = 0.5;
/// Part of the richer effect's gain that is enough for the simpler one that is its limit. *Argued.*
pub const SIMPLER: f64 = 0.95;
/// Effects that fit a piece of anything, from which on they are a poor man's free curve. *Argued.*
pub const LOCAL_TERMS: usize = 2;

// Hidden states.

/// Part of its gain that an effect keeps when its inner states go on from window to window. *Argued:* the greater part.
pub const CONTINUOUS: f64 = 0.5;
/// Swings within a window below which a resonance moves nothing there. *Argued:* half a swing is a drift.
pub const LEAST_SWINGS: f64 = 0.5;

// Recordings that were not fitted.

/// Part of its gain that an effect keeps on recordings left out. *Argued.*
pub const KEPT: f64 = 0.25;
/// Rows by which the instant of a reading may be off. *By definition:* it stands at the nearest row.
pub const HALF_A_ROW: f64 = 0.5;

/// How long a touchdown takes at most, s. *Stated:* soft contacts of simulators and rubber feet settle within it; what moves a robot
/// for longer is no contact's finish.
pub const TOUCHDOWN_S: f64 = 0.01;

// Sets of effects that the data do not tell apart.

/// Standard deviations of the difference below which two models are not told apart (Vuong 1989). *Argued:* 95 %.
pub const APART: f64 = 2.0;
/// Part of the winner's gain below which a lead is an error of form. *Argued.*
pub const FORM: f64 = 0.012;
/// Most of that, in twice the log-likelihood. *Argued:* five standard deviations, 25, and some rounding.
pub const FORM_AT_MOST: f64 = 30.0;
/// The same part where the winner leaves more than noise. *Measured* on recordings of hardware.
pub const FORM_IN_MISFIT: f64 = 0.1;
/// Gain that one more number brings by chance at most: past it the richer effect stands beside its limit. *Argued:* 1 in 2000.
pub const ONE_NUMBER: f64 = 12.0;
/// Part of the winner's gain that a member of its set has. *Argued.*
pub const MEMBER_GAIN: f64 = 0.5;
/// Most members of a set. *Stated:* more are no answer.
pub const MEMBERS: usize = 4;
/// Weight of an exact twin, which no motion tells from the winner, and the least weight of any member. *Stated.*
pub const TWIN_WEIGHT: f64 = 0.8;
/// See [`TWIN_WEIGHT`].
pub const LEAST_WEIGHT: f64 = 0.02;

// Forces without a name.

/// Excess of a free force that counts, at least. *Measured:* healthy cases stay below 20.
pub const FREE_FORCE: f64 = 80.0;
/// The same per sample. *Argued:* under the base's own noise most of a mismatch passes for colour.
pub const FREE_FORCE_PER_SAMPLE: f64 = 0.015;
/// Gain of a free force per number that is chance. *Argued:* three times its expectation.
pub const CHANCE_PER_NUMBER: f64 = 3.0;
/// Excess of a curve over position beside the listed effects from which a free force is fitted in their place. *Argued.*
pub const HINT: f64 = 50.0;
/// Part of the listed gain by which a free force is ahead of what was listed. *Tuned.*
pub const AHEAD_OF_LISTED: f64 = 1.25;
/// See [`AHEAD_OF_LISTED`]: besides, in twice the log-likelihood.
pub const AHEAD_OF_LISTED_BY: f64 = 60.0;
/// Part of the listed gain that a free force on top of the listed effects has. *Tuned.*
pub const ON_TOP: f64 = 0.3;
/// Part of the structure in the base's residual that a right effect may leave. *Argued.*
pub const STRUCTURE_LEFT: f64 = 0.15;
/// Part of all squares that the listed effects remove when they are the explanation. *Argued.*
pub const REMOVED: f64 = 0.8;
/// Part of the listed gain by which a change of the machine, or a fitted force over position, is ahead. *Argued:* no form is exact.
pub const AHEAD: f64 = 0.1;
/// Gain per number of a fitted force over position beside several ripples. *Argued:* twice what chance brings.
pub const RIPPLES_PER_NUMBER: f64 = 2.0;
/// Standard deviations by which a number is another one after a change of the machine. *Argued.*
pub const CHANGED: f64 = 3.0;

// Recordings of different machines, channels that follow nothing.

/// Factor by which residuals fall when each recording is fitted alone. *Argued.*
pub const ALONE: f64 = 3.0;
/// Residual over sample-to-sample noise that is explained. *Argued.*
pub const EXPLAINED: f64 = 2.0;
/// Residual over sample-to-sample noise that is no agreement, where it is [`UNFOLLOWED_SPREAD`] of the channel's spread. *Argued.*
pub const UNFOLLOWED: f64 = 5.0;
/// See [`UNFOLLOWED`].
pub const UNFOLLOWED_SPREAD: f64 = 0.3;

// What matters.

/// Smallest part of the misfit that an effect removes when it matters; `--least` asks for another. *Measured:* 13 of 186 healthy
/// cases of other simulators were called ill for something that removes .02 to .11; the least of a true one
/// was .13 in 88 cases with effects and .10 in `blind-dev` (a drive's limit).
pub const LEAST_SHARE: f64 = 0.08;

// What is noise.

/// Longest correlation of noise, in samples. *Measured:* healthy machines of other simulators come to 3.5, filtered noise (a pole
/// of .8) to 5; mismatches to 200.
pub const LONGEST_MEMORY: f64 = 6.0;
/// Part of the misfit after which a search that ended early has missed nothing to speak of. *Argued.*
pub const NEARLY_ALL: f64 = 0.95;
