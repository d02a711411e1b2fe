//! On what a number was measured, and the tables of numbers.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::io::{BufRead, Read, Write};
use std::path::Path;
use trisplat_scene::{Error, Result};

/// The machine and the state of the code.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Machine {
    /// Days as YYYY-MM-DD, UTC.
    pub date: String,
    /// Commit of the working tree the program runs in, when it is one.
    pub commit: String,
    /// Processor and number of cores.
    pub cpu: String,
}

impl Machine {
    /// This one.
    pub fn here() -> Self {
        let cpu = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let model = cpu.lines().find_map(|l| l.strip_prefix("model name")).unwrap_or(": unknown processor");
        let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
        Self {
            date: first_line(&["date", "-u", "+%Y-%m-%d"]),
            commit: first_line(&["git", "rev-parse", "--short", "HEAD"]),
            cpu: format!("{} x {cores}", model.trim_start_matches([' ', '\t', ':'])),
        }
    }
}

/// First line that a command prints; empty when it cannot be run.
fn first_line(command: &[&str]) -> String {
    std::process::Command::new(command[0])
        .args(&command[1..])
        .output()
        .ok()
        .filter(|o| o.status.success())
        .and_then(|o| String::from_utf8(o.stdout).ok())
        .and_then(|s| s.lines().next().map(str::to_owned))
        .unwrap_or_default()
}

/// Fails if the file `path` is there and no table of [`append_csv`].
pub fn check_csv(path: &Path) -> Result<()> {
    let start = match std::fs::File::open(path) {
        Ok(file) => file,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(Error::io(path, e)),
    };
    let (mut line, longest) = (Vec::new(), 1 << 16);
    let mut start = std::io::BufReader::new(start).take(longest);
    let read = start.read_until(b'\n', &mut line).map_err(|e| Error::io(path, e))?;
    let line = String::from_utf8_lossy(&line);
    let has = |name: &str| line.trim_end().split(',').any(|column| column == name);
    match read == 0 || columns(&Machine::default()).iter().all(|(name, _)| has(name)) {
        true => Ok(()),
        false => Err(Error::unsupported(path, "is no table of this benchmark; give the name of a new file")),
    }
}

/// Appends `rows` to the CSV file `path`, with a header when it is new. Columns are the fields of
/// [`Machine`], then those of the row; texts hold no commas, and what is absent is empty.
pub fn append_csv<T: Serialize>(path: &Path, machine: &Machine, rows: &[T]) -> Result<()> {
    let io = |e| Error::io(path, e);
    let is_new = !path.exists();
    let mut file = std::fs::File::options().create(true).append(true).open(path).map_err(io)?;
    for (i, row) in rows.iter().enumerate() {
        let mut columns = columns(machine);
        columns.extend(self::columns(row));
        if is_new && i == 0 {
            let names: Vec<&str> = columns.iter().map(|(name, _)| name.as_str()).collect();
            writeln!(file, "{}", names.join(",")).map_err(io)?;
        }
        let values: Vec<&str> = columns.iter().map(|(_, value)| value.as_str()).collect();
        writeln!(file, "{}", values.join(",")).map_err(io)?;
    }
    Ok(())
}

fn columns<T: Serialize>(row: &T) -> Vec<(String, String)> {
    let Ok(serde_json::Value::Object(map)) = serde_json::to_value(row) else { return Vec::new() };
    map.into_iter()
        .map(|(name, value)| match value {
            serde_json::Value::String(text) => (name, text.replace(',', ";")),
            serde_json::Value::Number(n) if n.is_f64() => {
                (name, format!("{:.4}", n.as_f64().unwrap_or(f64::NAN)))
            }
            serde_json::Value::Null => (name, String::new()),
            other => (name, other.to_string()),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_table_is_continued() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rows.csv");
        check_csv(&path).unwrap();
        append_csv(&path, &Machine::default(), &[Machine::default()]).unwrap();
        check_csv(&path).unwrap();
        std::fs::write(&path, b"\x89PNG\xff\n").unwrap();
        assert!(check_csv(&path).unwrap_err().to_string().contains("is no table"));
    }

    #[test]
    fn what_is_absent_is_empty_in_a_csv() {
        #[derive(Serialize)]
        struct Row {
            some: Option<f64>,
            none: Option<f64>,
            text: Option<String>,
        }
        let row = Row { some: Some(0.5), none: None, text: None };
        let values: Vec<String> =
            columns(&row).into_iter().map(|(name, value)| format!("{name}={value}")).collect();
        let mut sorted = values.clone();
        sorted.sort();
        assert_eq!(sorted, ["none=", "some=0.5000", "text="]);
    }
}
