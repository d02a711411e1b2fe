//! `info` and `validate`, as text and as JSON.

use super::sample;
use trisplat::cli::info::{InfoArgs, ValidateArgs, run, validate};
use trisplat_formats::{ReadOptions, info::Info};

#[test]
fn info_is_printed_as_text_and_as_json() {
    let input = sample("studio.ply");
    let print = |json: bool| {
        let mut out = Vec::new();
        run(
            &InfoArgs { input: input.clone(), json, dataset_options: Default::default() },
            &mut out,
        )
        .expect("valid");
        String::from_utf8(out).expect("text")
    };
    let text = print(false);
    for word in ["PLY", "triangles", "bounds", "up axis", "opacity", "sigma", "colors", "bake"] {
        assert!(text.contains(word), "{word}:\n{text}");
    }
    let parsed: Info = serde_json::from_str(&print(true)).expect("JSON of the documented shape");
    assert!(parsed.bake.is_some());
    let mut again = serde_json::to_string_pretty(&parsed).expect("JSON");
    again.push('\n');
    assert_eq!(again, print(true));
}

#[test]
fn validate_counts_the_findings_of_a_broken_file() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let input = folder.path().join("a.glb");
    std::fs::write(&input, b"glTF\x02\0\0\0").expect("written");
    let mut out = Vec::new();
    let args = ValidateArgs { input, json: false };
    assert!(validate(&args, &ReadOptions::default(), &mut out).is_err());
    assert!(String::from_utf8(out).expect("text").contains("1 error, 0 warnings, 0 notes"));
}
