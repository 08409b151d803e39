//! A configuration that reads well and that the rooms refuse: its plan, its tree, its gains, its drives, its ground. RT: no.

use crate::config::{Errors, Problem, Resolved};
use crate::control;
use crate::rt::tick::Tick;
use crate::sim::lockstep::{Lockstep, LockstepError};

/// Whether controller, and the simulated robot if it is one, can be built as configured.
pub(super) fn check(resolved: &Resolved) -> Result<(), Errors> {
    let config = &resolved.config;
    let built = if config.robot.is_simulated() {
        Lockstep::new(config).map(drop)
    } else {
        Tick::new(config).map(drop).map_err(LockstepError::from)
    };
    built.map_err(|error| all(resolved, &error))
}

/// Everything that is wrong with the controller, or else the error that stopped the building.
pub(super) fn all(resolved: &Resolved, first: &LockstepError) -> Errors {
    let refusals = control::refusals(&resolved.config);
    if refusals.is_empty() {
        let (file, what) = ("configuration".to_owned(), first.to_string());
        return Errors(vec![Problem { file, line: 0, key: String::new(), value: None, what }]);
    }
    let problem = |error: &control::ControllerError| {
        let (key, said) = (error.key(), error.to_string());
        let what = said.strip_prefix(key).and_then(|rest| rest.strip_prefix(": ")).unwrap_or(&said);
        resolved.problem(key, what.to_owned())
    };
    Errors(refusals.iter().map(problem).collect())
}

#[cfg(test)]
mod tests {
    use crate::cli::tests::usage_error;

    #[test]
    fn plans_and_trees_that_do_not_serve_are_refused_alike_everywhere_with_their_line() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("c.toml");
        let plans = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("config/plans");
        let gait = plans.join("gait_350mm_525mm_s.plan");
        let (gait, file) = (gait.to_str().unwrap(), file.to_str().unwrap());
        let text = "[set]\ncontrol.controller = \"tvlqr\"\ncontrol.walk.recover = true\n";
        std::fs::write(file, format!("{text}control.plan = \"{gait}\"\ncontrol.tree = \"{gait}\"\n")).unwrap();
        for command in
            [&["check-config", file][..], &["sim", "--config", file], &["run", "--for", "1", "--config", file]]
        {
            let error = usage_error(command);
            assert!(error.contains("2 errors"), "{command:?}: {error}");
            assert!(error.contains(&format!("{file}:4: control.plan: {gait}: ")), "{command:?}: {error}");
            assert!(error.contains("needs a plan of kind `rebalance`, this is a `gait`"), "{command:?}: {error}");
            assert!(
                error.contains(&format!("{file}:5: control.tree: {gait}: not a tree file")),
                "{command:?}: {error}"
            );
        }
        let error = usage_error(&[
            "check-config",
            "--set",
            "control.controller=lqr_tree",
            "--set",
            &format!("control.tree={file}"),
        ]);
        assert!(error.contains("--set: control.tree: ") && error.contains("not a tree file"), "{error}");
    }
}
