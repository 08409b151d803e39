//! What a command writes must not replace what it reads. RT: no.

use super::UsageError;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Refuses outputs of `option` that are an input of the same command, by whatever name or link.
pub(super) fn spare_inputs(
    option: &str,
    outputs: impl IntoIterator<Item = impl AsRef<Path>>,
    inputs: &[PathBuf],
) -> Result<(), UsageError> {
    for output in outputs {
        let output = output.as_ref();
        if let Some(input) = inputs.iter().find(|input| is_same(input, output)) {
            let (output, input) = (output.display(), input.display());
            return Err(UsageError(format!(
                "{option}: {output}: would replace the input {input}; must be another file"
            )));
        }
    }
    Ok(())
}

/// Refuses a folder for answers that is the case, or no folder at all.
pub(super) fn spare_case(option: &str, out: &Path, case: Option<&Path>) -> Result<(), UsageError> {
    must_be_folder(option, out)?;
    if case.is_some_and(|case| is_same(out, case)) {
        let what = "is the case, into which nothing is written; must be another folder, one within it at most";
        return Err(UsageError(format!("{option}: {}: {what}", out.display())));
    }
    Ok(())
}

/// Refuses a file where a folder shall be made or used.
pub(super) fn must_be_folder(option: &str, out: &Path) -> Result<(), UsageError> {
    if out.exists() && !out.is_dir() {
        let what = "is a file; must be a folder, or a name that nothing has yet";
        return Err(UsageError(format!("{option}: {}: {what}", out.display())));
    }
    Ok(())
}

/// The files that lie in a folder; none if it is no folder.
pub(super) fn files_in(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).filter(|path| path.is_file()).collect()
}

/// Both names lead to the same file or folder. What is not there yet is the same as nothing.
pub(super) fn is_same(a: &Path, b: &Path) -> bool {
    identity(a).is_some_and(|a| identity(b) == Some(a))
}

/// Device and inode. None for pipes and terminals: a command may read from one and write to it.
fn identity(path: &Path) -> Option<(u64, u64)> {
    let data = fs::metadata(path).ok()?;
    (data.is_file() || data.is_dir()).then(|| (data.dev(), data.ino()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::tests::usage_error;

    #[test]
    fn an_output_that_is_an_input_by_any_name_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("a.csv"), "t_s\n").unwrap();
        fs::write(at("b.csv"), "t_s\n").unwrap();
        fs::create_dir(at("sub")).unwrap();
        fs::hard_link(at("a.csv"), at("hard.csv")).unwrap();
        std::os::unix::fs::symlink(at("a.csv"), at("soft.csv")).unwrap();
        for name in ["a.csv", "hard.csv", "soft.csv", "sub/../a.csv"] {
            let error = spare_inputs("--out", [at(name)], &[at("b.csv"), at("a.csv")]).unwrap_err().to_string();
            assert!(error.starts_with("--out: ") && error.contains(name), "{error}");
        }
        for name in ["b.csv", "new.csv", "nowhere/a.csv"] {
            assert!(spare_inputs("--out", [at(name)], &[at("a.csv"), at("gone.csv")]).is_ok(), "{name}");
        }
        let null = PathBuf::from("/dev/null");
        assert!(spare_inputs("--out", [&null], std::slice::from_ref(&null)).is_ok());
    }

    /// A copy of the pendulum's case, with a file for everything else that a command reads.
    fn inputs() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let case = Path::new(env!("CARGO_MANIFEST_DIR")).join("cases/pendulum");
        for file in files_in(&case) {
            fs::copy(&file, folder.path().join(file.file_name().unwrap())).unwrap();
        }
        for name in ["r.mcap", "g.plan", "e.toml"] {
            fs::write(folder.path().join(name), "precious").unwrap();
        }
        folder
    }

    #[test]
    fn no_command_replaces_what_it_reads() {
        let folder = inputs();
        let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let read = || files_in(folder.path()).iter().map(|f| fs::read(f).unwrap()).collect::<Vec<_>>();
        let before = read();
        for line in [
            "predict @rig.toml @run_a.csv --out @run_a.csv",
            "predict @rig.toml @run_a.csv --out @rig.toml",
            "predict @rig.toml @run_a.csv --out @run_b.csv",
            "predict @rig.toml --out @.",
            "predict @rig.toml @run_a.csv --out @new.svg",
            "simulate @rig.toml --input @run_a.csv --out @run_a.csv",
            "simulate @rig.toml --input @run_a.csv --out @rig.toml",
            "inspect @r.mcap --page @r.mcap",
            "inspect @r.mcap --animation @r.mcap",
            "plan show @g.plan --out @g.plan",
            "plan stop @g.plan --out @g.plan",
            "plan step-in @g.plan --stance inner --out @g.plan",
            "plan change @new.plan @g.plan --out @g.plan",
            "plan gait --step .4 --speed .4 --config @e.toml --out @e.toml",
            "plan tree --config @e.toml --out @e.toml",
            "diagnose @. --trace @run_a.csv",
            "diagnose --own @r.mcap --trace @r.mcap",
            "bench latency --config @e.toml --html @e.toml",
            "score @. --truth @. --out @rig.toml",
            "score @. --truth @. --answers @..",
        ] {
            let words: Vec<String> =
                line.split(' ').map(|word| word.strip_prefix('@').map_or(word.to_owned(), at)).collect();
            let error = usage_error(&words.iter().map(String::as_str).collect::<Vec<_>>());
            assert!(error.contains("must "), "{line}: {error}");
            assert_eq!(read(), before, "{line}");
        }
    }

    #[test]
    fn answers_go_neither_into_the_case_nor_into_a_file() {
        let folder = inputs();
        let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let names = || files_in(folder.path()).len();
        let before = names();
        for (line, told) in [
            ("diagnose @. --out @.", "is the case"),
            ("identify @. --out @../@", "is the case"),
            ("diagnose @. --trace @new.jsonl", "lies in the case"),
            ("diagnose @. --out @rig.toml", "must be a folder"),
            ("identify @. --out @rig.toml", "must be a folder"),
            ("predict @rig.toml --out @run_a.csv", "must be a folder"),
            ("simulate --thesis cad --out @run_a.csv", "must be a folder"),
            ("experiment @e.toml --out @run_a.csv", "must be a folder"),
            ("sim --for 1 --record @run_a.csv", "must be a folder"),
            ("run --for 1s --record @run_a.csv", "must be a folder"),
            ("trial --cases 1 --out @run_a.csv", "must be a folder"),
        ] {
            let line = line.replace("../@", &format!("../{}", folder.path().file_name().unwrap().to_str().unwrap()));
            let words: Vec<String> =
                line.split(' ').map(|word| word.strip_prefix('@').map_or(word.to_owned(), at)).collect();
            let error = usage_error(&words.iter().map(String::as_str).collect::<Vec<_>>());
            assert!(error.contains(told), "{line}: {error}");
            assert_eq!(names(), before, "{line}");
        }
        assert!(spare_case("--out", &folder.path().join("answer"), Some(folder.path())).is_ok());
    }
}
