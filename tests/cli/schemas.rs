//! The checked-in schemas are those of the code; samples and real reports satisfy them.

use clap::ValueEnum;
use serde_json::Value;
use std::io::Write;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use trisplat::cli::schema::SchemaName;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn schemas_are_current() {
    for name in SchemaName::value_variants() {
        let word = name.to_possible_value().unwrap().get_name().to_owned();
        let path = root().join(format!("schemas/{word}.schema.json"));
        if std::env::var_os("UPDATE").is_some() {
            std::fs::write(&path, name.text()).unwrap();
        }
        let there = std::fs::read_to_string(&path).unwrap_or_default();
        assert_eq!(
            there,
            name.text(),
            "{} is stale: run UPDATE=1 cargo test --test program schemas",
            path.display()
        );
    }
}

/// What Python's jsonschema package finds: one line per error, none when the value is valid.
/// Without that Python `None` and a message, or a failure where the external tools are required.
fn validate(name: SchemaName, value: &Value) -> Option<String> {
    const SCRIPT: &str = "import json, sys, jsonschema
schema, value = json.load(sys.stdin)
jsonschema.Draft202012Validator.check_schema(schema)
for e in jsonschema.Draft202012Validator(schema).iter_errors(value): print(e.json_path, e.message)";
    let python = root().join("target/judges/venv/bin/python");
    if !python.exists() {
        assert!(
            std::env::var_os("TRISPLAT_REQUIRE_JUDGES").is_none(),
            "no Python at {}",
            python.display()
        );
        trisplat_fixtures::skip::skipped("no target/judges: run tests/run.sh");
        return None;
    }
    let schema: Value = serde_json::from_str(&name.text()).unwrap();
    let mut child = Command::new(python)
        .args(["-c", SCRIPT])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let question = serde_json::to_vec(&serde_json::json!([schema, value])).unwrap();
    child.stdin.take().unwrap().write_all(&question).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "the schema validator failed");
    Some(String::from_utf8(output.stdout).unwrap())
}

fn satisfies(name: SchemaName, value: &Value) {
    if let Some(errors) = validate(name, value) {
        assert_eq!(errors, "");
    }
}

#[test]
fn the_sample_config_satisfies_its_schema() {
    let text = std::fs::read_to_string(root().join("samples/bake.json")).unwrap();
    satisfies(SchemaName::Bake, &serde_json::from_str(&text).unwrap());
}

/// The report that a run of the program writes.
fn report_of(arguments: &[&str]) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("report.json");
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command.current_dir(root()).args(arguments).args(["-q", "--report"]).arg(&report);
    assert!(command.status().unwrap().success());
    serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap()
}

#[test]
fn a_real_report_satisfies_its_schema() {
    let value = report_of(&["bake", "samples/soups/studio.ply", "--dry-run", "-o", "scene.glb"]);
    satisfies(SchemaName::Report, &value);
    satisfies(SchemaName::Bake, &value["options"]);
}

#[test]
fn the_report_of_a_training_has_the_same_shape() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.ply").display().to_string();
    let value =
        report_of(&["train", "samples/dataset", "--steps", "3", "--teacher", "off", "-o", &scene]);
    satisfies(SchemaName::Report, &value);
    satisfies(SchemaName::Train, &value["options"]);
    let [evidence, teacher, stage] = [0, 1, 2].map(|stage| &value["stages"][stage]);
    assert_eq!(evidence["name"], "evidence");
    assert_eq!(
        (&teacher["name"], &teacher["skipped"]),
        (&"teacher".into(), &"`teacher` off".into())
    );
    assert_eq!((&value["command"], &stage["name"]), (&"train".into(), &"train".into()));
    assert!(
        stage["details"]["psnr"].as_f64().is_some()
            && stage["after"]["triangles"].as_u64() > Some(0)
    );
    assert_eq!(value["outputs"].as_array().map(Vec::len), Some(1));
}

#[test]
fn what_eval_and_info_write_satisfies_their_schemas() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("eval.json");
    let soup = root().join("samples/soups/studio.ply");
    let dataset = root().join("samples/dataset");
    let run = |command: &mut Command| {
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        output.stdout
    };
    let trisplat = || Command::new(env!("CARGO_BIN_EXE_trisplat"));
    run(trisplat().arg("eval").arg(soup).arg(&dataset).arg("--report").arg(&report));
    let eval: Value = serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
    satisfies(SchemaName::Eval, &eval);
    let info = run(trisplat().args(["info", "--json"]).arg(&dataset));
    satisfies(SchemaName::Dataset, &serde_json::from_slice(&info).unwrap());
}

#[test]
fn a_wrong_config_does_not_satisfy_the_schema() {
    for wrong in [
        serde_json::json!({ "prune": { "min_opacty": 0.5 } }),
        serde_json::json!({ "output": { "target": "quake" } }),
    ] {
        assert_ne!(validate(SchemaName::Bake, &wrong), Some(String::new()), "{wrong}");
    }
}

#[test]
fn sh_extras_of_a_bake_satisfy_their_schema() {
    let folder = tempfile::tempdir().unwrap();
    let glb = folder.path().join("scene.glb");
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    let photos = ["--dataset", "samples/dataset", "--sh", "1", "--set", "reshape=off"];
    command.current_dir(root()).args(["bake", "-q", "samples/soups/trained.ply"]).args(photos);
    assert!(command.arg("-o").arg(&glb).status().unwrap().success());
    let bytes = std::fs::read(&glb).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let document: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let mut extras = document["materials"][0]["extras"]["trisplat_sh"].clone();
    satisfies(SchemaName::Sh, &extras);
    extras["degree"] = 4.into();
    let errors = validate(SchemaName::Sh, &extras);
    assert!(errors.is_none_or(|errors| errors.contains("$.degree")));
}
