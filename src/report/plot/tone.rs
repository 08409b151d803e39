//! What a colour means, everywhere the same. RT: no.

/// The role of a mark. Colours after Okabe and Ito (2008): apart for all common kinds of colour blindness.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    /// What was recorded: ink.
    Measured,
    /// The simulation as given: grey, dotted.
    Given,
    /// Its parameters fitted again: vermilion, dashed.
    Refitted,
    /// With what was found: blue.
    Explained,
    /// Where to look: yellow.
    Attention,
    /// One of several equals: 0..=5, then from the start.
    Series(u8),
}

impl Tone {
    /// The class of the style sheet.
    pub(super) fn class(self) -> &'static str {
        const SERIES: [&str; 6] = ["s0", "s1", "s2", "s3", "s4", "s5"];
        match self {
            Self::Measured => "measured",
            Self::Given => "given",
            Self::Refitted => "refitted",
            Self::Explained => "explained",
            Self::Attention => "attention",
            Self::Series(n) => SERIES[usize::from(n) % SERIES.len()],
        }
    }
}

/// Colours and dashes; the page and the single files share it.
pub const STYLE: &str = "\
:root{--paper:#fff;--ink:#1b1f24;--soft:#5b6570;--faint:#d9dee3;--measured:#1b1f24;--given:#8a939c;--refitted:#d55e00;\
--explained:#0072b2;--attention:#f0c808;--s2:#009e73;--s3:#cc79a7;--s4:#e69f00;--s5:#56b4e9}\
@media (prefers-color-scheme:dark){:root{--paper:#14181d;--ink:#e6e9ec;--soft:#9aa5b1;--faint:#333b45;\
--measured:#e6e9ec;--given:#7d8894;--refitted:#ff8a3d;--explained:#56b4e9;--attention:#b8990a;--s2:#2fc79a;--s3:#e29ac4;\
--s4:#f2b632;--s5:#9ad7ff}}\
@media print{:root{--paper:#fff;--ink:#000;--soft:#444;--faint:#ccc;--measured:#000;--given:#777;--refitted:#d55e00;\
--explained:#0072b2;--attention:#f0c808;--s2:#009e73;--s3:#cc79a7;--s4:#e69f00;--s5:#56b4e9}}\
svg.plot{font:12px system-ui,-apple-system,'Segoe UI',Roboto,'Liberation Sans',sans-serif;background:var(--paper)}\
svg.plot text{fill:var(--soft)}svg.plot text.title{fill:var(--ink);font-weight:600;font-size:13px}\
svg.plot text.strong{fill:var(--ink)}\
svg.plot .grid{stroke:var(--faint);stroke-width:1;fill:none}svg.plot .zero{stroke:var(--soft);stroke-width:1}\
svg.plot .line{fill:none;stroke-width:1.6;stroke-linejoin:round;stroke-linecap:round}\
svg.plot .measured{stroke:var(--measured)}svg.plot .given{stroke:var(--given);stroke-dasharray:1.5 3.5}\
svg.plot .refitted{stroke:var(--refitted);stroke-dasharray:6 3}svg.plot .explained{stroke:var(--explained)}\
svg.plot .attention{stroke:var(--attention)}svg.plot .s0{stroke:var(--explained)}\
svg.plot .s1{stroke:var(--refitted);stroke-dasharray:6 3}svg.plot .s2{stroke:var(--s2);stroke-dasharray:2 2}\
svg.plot .s3{stroke:var(--s3);stroke-dasharray:8 3 2 3}svg.plot .s4{stroke:var(--s4);stroke-dasharray:3 4}\
svg.plot .s5{stroke:var(--s5);stroke-dasharray:10 4}svg.plot .arrow{stroke-dasharray:none}\
svg.plot .line.measured{stroke-width:3.2;opacity:.42}\
svg.plot .area{stroke:none;opacity:.22}svg.plot .bar{stroke:none;opacity:.85}\
svg.plot .area.measured,svg.plot .bar.measured{fill:var(--measured)}\
svg.plot .area.given,svg.plot .bar.given{fill:var(--given)}\
svg.plot .area.refitted,svg.plot .bar.refitted{fill:var(--refitted)}\
svg.plot .area.explained,svg.plot .bar.explained,svg.plot .area.s0,svg.plot .bar.s0{fill:var(--explained)}\
svg.plot .area.attention,svg.plot .bar.attention{fill:var(--attention)}\
svg.plot .area.s1,svg.plot .bar.s1{fill:var(--refitted)}svg.plot .area.s2,svg.plot .bar.s2{fill:var(--s2)}\
svg.plot .area.s3,svg.plot .bar.s3{fill:var(--s3)}svg.plot .area.s4,svg.plot .bar.s4{fill:var(--s4)}\
svg.plot .area.s5,svg.plot .bar.s5{fill:var(--s5)}";
