//! `trisplat schema NAME`: JSON Schemas, generated from the types they describe.

use crate::error::{Error, Result};
use std::io::Write;

/// Which schema.
#[derive(Debug, clap::Args)]
pub struct SchemaArgs {
    /// What it describes.
    #[arg(value_enum)]
    pub name: SchemaName,
}

/// The schemas there are; each is checked in as `schemas/NAME.schema.json`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum SchemaName {
    /// The file given to `trisplat bake --config`.
    Bake,
    /// The file written by `--report`.
    Report,
}

impl SchemaName {
    /// The schema as pretty JSON with a final newline.
    pub fn text(self) -> String {
        let schema = match self {
            SchemaName::Bake => {
                let mut schema = schemars::schema_for!(crate::bake::options::BakeOptions);
                allow_schema_key(&mut schema);
                schema
            }
            SchemaName::Report => schemars::schema_for!(crate::report::Report),
        };
        let mut text = serde_json::to_string_pretty(&schema).unwrap_or_default();
        text.push('\n');
        text
    }
}

/// Config files may name their schema, for editors.
fn allow_schema_key(schema: &mut schemars::Schema) {
    if let Some(properties) = schema.get_mut("properties").and_then(|p| p.as_object_mut()) {
        properties.insert(
            "$schema".to_owned(),
            serde_json::json!({ "type": "string", "description": "Where this schema is; for editors." }),
        );
    }
}

/// Prints the schema to standard output.
pub fn run(args: &SchemaArgs) -> Result<()> {
    std::io::stdout().write_all(args.name.text().as_bytes()).map_err(|e| Error::io("-", e))
}
