//! What docs/install.md promises.

use super::trisplat;

#[test]
fn the_version_names_where_it_is_from_and_its_features() {
    let said = String::from_utf8(trisplat(&[&"--version"]).stdout).unwrap();
    let said = said.trim();
    let (version, rest) = said.split_once(" (").unwrap_or_else(|| panic!("{said}"));
    assert_eq!(version, concat!("trisplat ", env!("CARGO_PKG_VERSION")));
    let (from, features) =
        rest.trim_end_matches(')').split_once("; ").unwrap_or_else(|| panic!("{said}"));
    assert_eq!(from, option_env!("TRISPLAT_COMMIT").unwrap_or("built from source"));
    let names = [("gpu", cfg!(feature = "gpu")), ("view", cfg!(feature = "view"))];
    for (name, on) in names {
        assert_eq!(features.split(", ").any(|feature| feature == name), on, "{said}");
    }
}

/// The line of the page installs from an archive that is packed as `.github/workflows/release.yml`
/// packs it.
#[cfg(unix)]
#[test]
fn the_line_of_the_page_installs_a_release() {
    use std::os::unix::fs::PermissionsExt;
    use std::path::Path;
    use std::process::Command;
    let page =
        std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/install.md"))
            .unwrap();
    let line = page.split("```sh\n").nth(1).unwrap().split("```").next().unwrap();
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| home.path().join(name);
    let name = "trisplat-v1.2.3-x86_64-unknown-linux-musl";
    std::fs::create_dir(at(name)).unwrap();
    let program = at(name).join("trisplat");
    std::fs::write(&program, "#!/bin/sh\necho installed\n").unwrap();
    std::fs::set_permissions(&program, PermissionsExt::from_mode(0o755)).unwrap();
    std::fs::write(at(name).join("README.md"), "").unwrap();
    let packed = Command::new("tar")
        .args(["-czf", &format!("{name}.tar.gz"), name])
        .current_dir(home.path())
        .status();
    assert!(packed.unwrap().success());
    let mut shell = Command::new("sh");
    shell.args(["-euc", line]).env("HOME", home.path()).env("TAG", "v1.2.3");
    let done = shell.env("RELEASE", format!("file://{}", home.path().display())).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let bin = std::fs::read_dir(at(".local/bin")).unwrap().map(|file| file.unwrap().file_name());
    assert_eq!(bin.collect::<Vec<_>>(), ["trisplat"]);
    let said = Command::new(at(".local/bin/trisplat")).output().unwrap();
    assert_eq!(said.stdout, b"installed\n");
}
