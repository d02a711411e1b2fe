//! The checked-in schemas are those of the code; samples and real reports satisfy them.

use clap::ValueEnum;
use serde_json::Value;
use std::path::PathBuf;
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
        assert_eq!(there, name.text(), "{} is stale: run UPDATE=1 cargo test --test schemas", path.display());
    }
}

/// Checks `value` against the schema of `name` with an independent validator.
fn satisfies(name: SchemaName, value: &Value) {
    let schema: Value = serde_json::from_str(&name.text()).unwrap();
    let validator = jsonschema::validator_for(&schema).unwrap();
    let errors: Vec<String> =
        validator.iter_errors(value).map(|e| format!("{}: {e}", e.instance_path())).collect();
    assert!(errors.is_empty(), "{errors:#?}");
}

#[test]
fn the_sample_config_satisfies_its_schema() {
    let text = std::fs::read_to_string(root().join("samples/bake.json")).unwrap();
    satisfies(SchemaName::Bake, &serde_json::from_str(&text).unwrap());
}

#[test]
fn a_real_report_satisfies_its_schema() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("report.json");
    let status = std::process::Command::new(env!("CARGO_BIN_EXE_trisplat"))
        .arg("bake")
        .arg(root().join("samples/soups/studio.ply"))
        .args(["-q", "--dry-run", "-o", "scene.glb", "--report"])
        .arg(&report)
        .status()
        .unwrap();
    assert!(status.success());
    let value: Value = serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
    satisfies(SchemaName::Report, &value);
    satisfies(SchemaName::Bake, &value["options"]);
}

#[test]
fn a_wrong_config_does_not_satisfy_the_schema() {
    let schema: Value = serde_json::from_str(&SchemaName::Bake.text()).unwrap();
    let validator = jsonschema::validator_for(&schema).unwrap();
    assert!(!validator.is_valid(&serde_json::json!({ "prune": { "min_opacty": 0.5 } })));
    assert!(!validator.is_valid(&serde_json::json!({ "output": { "target": "quake" } })));
}
