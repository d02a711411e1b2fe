//! Flags of all commands.

use trisplat_scene::{Limits, Result};

/// Flags every command takes.
#[derive(Debug, Clone, Default, clap::Args)]
#[command(next_help_heading = "Everywhere")]
pub struct Global {
    /// Print errors only.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Print every figure of every stage.
    #[arg(short, long, global = true)]
    pub verbose: bool,
    /// Worker threads, at most four per core; 0 = one per core. The output is the same bytes for any number.
    #[arg(long, global = true, default_value_t = 0, value_name = "N", hide_short_help = true)]
    pub threads: u16,
    /// Raise or lower a limit on inputs, as in triangles=100000000; may be given often. The keys:
    /// picture_side, picture_pixels, camera_pixels, triangles, vertices, file_bytes, document_bytes,
    /// array_bytes, nodes, nesting, threads_per_core.
    #[arg(long, global = true, value_name = "KEY=VALUE", hide_short_help = true)]
    pub limit: Vec<String>,
    /// Permit a data set or a glTF document to name files outside its folder.
    #[arg(long, global = true, hide_short_help = true)]
    pub allow_outside: bool,
}

impl Global {
    /// The limits with the changes of `--limit`. Errors: no such limit.
    pub fn limits(&self) -> Result<Limits> {
        let mut limits = Limits::DEFAULT;
        self.limit.iter().try_for_each(|setting| limits.set(setting))?;
        Ok(limits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Args;

    #[test]
    fn the_help_lists_every_limit() {
        let command = Global::augment_args(clap::Command::new("trisplat"));
        let help = command.get_arguments().find(|a| a.get_id() == "limit").and_then(|a| a.get_help());
        let help = help.map(ToString::to_string).unwrap_or_default();
        let keys = serde_json::to_value(Limits::DEFAULT).unwrap();
        for key in keys.as_object().unwrap().keys() {
            assert!(help.contains(key.as_str()), "{key}: {help}");
        }
    }
}
