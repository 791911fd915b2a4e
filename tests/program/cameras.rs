//! Options that need cameras to say what they mean.

use crate::common::{assert_schema, fixture, folder, program};

#[test]
fn the_program_needs_cameras_for_it() {
    let folder = folder();
    let bake = |options: &[&str]| {
        let mut command = program();
        let scene = fixture("trained/lego64/fine_last.tar");
        command.current_dir(folder.path()).arg("bake").arg(scene).args(["--stepsize", "0.5"]);
        command.args(["-o", "out.mipvog", "--force", "--format", "json"]).args(options);
        command.output().expect("starts")
    };
    for option in [["--min-weight", "1e-3"], ["--coarseness", "1"]] {
        assert_eq!(bake(&option).status.code(), Some(2));
        let seen = ["--turntable", "2", "--size", "40x40"];
        let output = bake(&[&option[..], &seen].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let report = serde_json::from_slice(&output.stdout).expect("a report");
        assert_schema("bake", &report);
        assert_eq!(report["options"]["seen_from"]["count"], 2);
    }
}
