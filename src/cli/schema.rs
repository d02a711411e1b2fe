//! `trisplat schema NAME`: JSON Schemas, generated from their types.

use super::messages::Stdout;
use clap_mangen::Man;
use std::io::Write;
use std::path::PathBuf;
use trisplat_bake::refit::RefitDetails;
use trisplat_bake::unseen::UnseenDetails;
use trisplat_bake::{
    ArrangeDetails, BackdropDetails, BackgroundDetails, BakeOptions, ChunkDetails, ColorDetails,
    CropDetails, EraseDetails, ExposureDetails, LitDetails, LodDetails, OrderDetails, PlaceDetails,
    PruneDetails, ReshapeDetails, ShDetails, SidesDetails, SimplifyDetails, SolidDetails,
    TeacherDetails, TextureDetails, TilesDetails, ViewpointDetails, WeldDetails,
};
use trisplat_dataset::Description;
use trisplat_dataset::capture::{
    FeaturesDetails, MatchesDetails, ModelDetails, PhotosDetails, VerdictDetails,
};
use trisplat_dataset::exposure::ExposureEvidence;
use trisplat_formats::check::Checked;
use trisplat_formats::gltf::ShExtras;
use trisplat_formats::info::Info;
use trisplat_formats::output::WriteDetails;
use trisplat_job::EvalReport;
use trisplat_scale::Manifest;
use trisplat_scene::atomic::AtomicFolder;
use trisplat_scene::report::{Report, stage_schema};
use trisplat_scene::{Error, Result};
use trisplat_surface::{CollisionDetails, SurfaceDetails};
use trisplat_train::{DepthsDetails, TrainDetails, TrainOptions};

/// Schema to print.
#[derive(Debug, clap::Args)]
pub struct SchemaArgs {
    /// Kind of the file.
    #[arg(value_enum)]
    pub name: SchemaName,
}

/// The schemas; each is checked in as `schemas/NAME.schema.json`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum SchemaName {
    /// The file given to `trisplat bake --config`.
    Bake,
    /// The file given to `trisplat train --config`.
    Train,
    /// The file written by `--report`.
    Report,
    /// The output of `trisplat info --json` for a file.
    Info,
    /// The output of `trisplat info --json` for a data set.
    Dataset,
    /// The file `manifest.json` written by `trisplat plan`.
    Plan,
    /// The file written by `trisplat eval --report`.
    Eval,
    /// Output of `trisplat validate --json`.
    Validate,
    /// The extras `trisplat_sh` of a material with view-dependent colours.
    Sh,
}

impl SchemaName {
    /// The schema as pretty JSON with a final newline.
    pub fn text(self) -> String {
        let schema = match self {
            SchemaName::Bake => config_schema(schemars::schema_for!(BakeOptions)),
            SchemaName::Train => config_schema(schemars::schema_for!(TrainOptions)),
            SchemaName::Report => report_schema(),
            SchemaName::Info => schemars::schema_for!(Info),
            SchemaName::Dataset => schemars::schema_for!(Description),
            SchemaName::Plan => schemars::schema_for!(Manifest),
            SchemaName::Eval => schemars::schema_for!(EvalReport),
            SchemaName::Validate => schemars::schema_for!(Checked),
            SchemaName::Sh => schemars::schema_for!(ShExtras),
        };
        let mut schema = serde_json::to_value(&schema).unwrap_or_default();
        unwrap_lines(&mut schema);
        let mut text = serde_json::to_string_pretty(&schema).unwrap_or_default();
        text.push('\n');
        text
    }
}

/// Joins the lines of a paragraph of each description: the source code wraps them.
fn unwrap_lines(value: &mut serde_json::Value) {
    match value {
        serde_json::Value::Object(members) => {
            for (key, member) in members {
                match member {
                    serde_json::Value::String(text) if key == "description" => {
                        let paragraphs = text.split("\n\n").map(|lines| lines.replace('\n', " "));
                        *text = paragraphs.collect::<Vec<_>>().join("\n\n");
                    }
                    member => unwrap_lines(member),
                }
            }
        }
        serde_json::Value::Array(items) => items.iter_mut().for_each(unwrap_lines),
        _ => {}
    }
}

/// Config files may name their schema, for editors.
fn config_schema(mut schema: schemars::Schema) -> schemars::Schema {
    if let Some(properties) = schema.get_mut("properties").and_then(|p| p.as_object_mut()) {
        properties.insert(
            "$schema".to_owned(),
            serde_json::json!({ "type": "string", "description": "Where this schema is; for editors." }),
        );
    }
    schema
}

/// A report with the details of each stage.
fn report_schema() -> schemars::Schema {
    let mut generator = schemars::generate::SchemaSettings::draft2020_12().into_generator();
    macro_rules! schemas { ($($details:ty),*) => { [$(stage_schema::<$details>(&mut generator)),*] } }
    let stages = schemas!(
        PhotosDetails,
        FeaturesDetails,
        MatchesDetails,
        ModelDetails,
        VerdictDetails,
        BackgroundDetails,
        CropDetails,
        SimplifyDetails,
        ArrangeDetails,
        ExposureEvidence,
        TeacherDetails,
        CollisionDetails,
        DepthsDetails,
        SurfaceDetails,
        TilesDetails,
        PruneDetails,
        SolidDetails,
        ColorDetails,
        UnseenDetails,
        ExposureDetails,
        BackdropDetails,
        ReshapeDetails,
        SidesDetails,
        EraseDetails,
        RefitDetails,
        ShDetails,
        TextureDetails,
        LitDetails,
        WeldDetails,
        PlaceDetails,
        ViewpointDetails,
        ChunkDetails,
        OrderDetails,
        LodDetails,
        WriteDetails,
        TrainDetails
    );
    let mut schema = generator.into_root_schema_for::<Report>();
    if let Some(stage) = schema.pointer_mut("/$defs/StageReport").and_then(|s| s.as_object_mut()) {
        stage.insert("oneOf".to_owned(), serde_json::json!(Vec::from(stages)));
    }
    schema
}

/// Prints the schema to standard output.
pub fn run(args: &SchemaArgs) -> Result<()> {
    Stdout.write_all(args.name.text().as_bytes()).map_err(|e| Error::io("-", e))
}

// ---- What is generated from the flags: manual pages and completions -----------------------------

/// The main page, which names all others.
const PROGRAM_PAGE: &str = "trisplat.1";

/// Folder of the pages.
#[derive(Debug, clap::Args)]
pub struct ManArgs {
    /// Folder for the pages; made if missing. Pages in it are replaced.
    #[arg(value_name = "FOLDER")]
    pub folder: PathBuf,
}

/// Writes trisplat.1, trisplat-bake.1 and so on.
pub fn man(args: &ManArgs, program: clap::Command) -> Result<()> {
    let folder = AtomicFolder::create(&args.folder)?;
    let mut program = program.disable_help_subcommand(true);
    program.build();
    write_pages(program, &folder)?;
    folder.publish(PROGRAM_PAGE)
}

/// Writes the pages of a command and its subcommands, each in one write, because rendering into a
/// file would take hundreds.
fn write_pages(command: clap::Command, folder: &AtomicFolder) -> Result<()> {
    for below in command.get_subcommands().filter(|below| !below.is_hide_set()).cloned() {
        write_pages(below, folder)?;
    }
    let page = Man::new(command);
    let mut text = Vec::new();
    let path = folder.place(page.get_filename())?;
    page.render(&mut text)
        .and_then(|()| std::fs::write(&path, text))
        .map_err(|e| Error::io(&path, e))
}

/// Shell of the script.
#[derive(Debug, clap::Args)]
pub struct CompletionsArgs {
    /// The shell to complete for.
    pub shell: clap_complete::Shell,
}

/// Prints the completion script of `program` to standard output.
pub fn completions(args: &CompletionsArgs, program: &mut clap::Command) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, program, "trisplat", &mut script);
    Stdout.write_all(&script).map_err(|e| Error::io("-", e))
}
