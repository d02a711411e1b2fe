//! Every option that trades seconds or bytes for error, declared once.
//!
//! A name is that of the option's own field; of two options of one stage that are called alike there is none. Values lie
//! around the default, the one that says most first: with `--quick` it is the only one. The default itself is not
//! listed: it is read from the options.

use KnobValue::{Is, Times};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A part of the way from photos to pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum CostStage {
    /// Photos to a soup.
    Train,
    /// A soup to a file.
    Bake,
    /// A file or a soup to pictures.
    Draw,
    /// Photos to a file: training and bake together.
    #[value(skip)]
    Chain,
}

/// What a stage is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CostInput {
    /// The photos to train on.
    Photos,
    /// The result of the default training: opaque triangles; the bake has the photos too.
    SolidSoup,
    /// The result of training with preset outdoor: soft triangles; the bake has no photos.
    SoftSoup,
    /// The file of the default bake of the solid soup.
    File,
}

/// A value of an option.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum KnobValue {
    /// This one, as it is typed.
    Is(&'static str),
    /// A factor of the default, or of what stands for it: the triangles of the soup, the longer side of the photos.
    Times(f64),
}

/// An option and the values that are tried.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knob {
    /// The option, by its name in configs.
    pub name: &'static str,
    /// The stage that it belongs to.
    pub stage: CostStage,
    /// What that stage is given.
    pub input: CostInput,
    /// What is tried besides the default, the most telling value first.
    pub values: &'static [KnobValue],
    /// The scene stays what it is: its pictures are compared with those of the default, which is the exact answer.
    pub same_scene: bool,
    /// What the dearer values are for, besides seconds, bytes and error; empty for nothing else.
    pub buys: &'static str,
}

/// Two options that are changed together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// The stage that they belong to.
    pub stage: CostStage,
    /// What that stage is given.
    pub input: CostInput,
    /// The options and their values.
    pub changes: [(&'static str, KnobValue); 2],
}

const fn knob(stage: CostStage, input: CostInput, name: &'static str, values: &'static [KnobValue]) -> Knob {
    Knob { name, stage, input, values, same_scene: false, buys: "" }
}

const fn train(name: &'static str, values: &'static [KnobValue]) -> Knob {
    knob(CostStage::Train, CostInput::Photos, name, values)
}

const fn bake(name: &'static str, values: &'static [KnobValue]) -> Knob {
    knob(CostStage::Bake, CostInput::SolidSoup, name, values)
}

/// A bake that leaves the scene as it is.
const fn format(name: &'static str, values: &'static [KnobValue], buys: &'static str) -> Knob {
    Knob { same_scene: true, buys, ..bake(name, values) }
}

const fn soft(name: &'static str, values: &'static [KnobValue]) -> Knob {
    knob(CostStage::Bake, CostInput::SoftSoup, name, values)
}

const fn draw(input: CostInput, name: &'static str, values: &'static [KnobValue]) -> Knob {
    Knob { same_scene: true, ..knob(CostStage::Draw, input, name, values) }
}

/// Every option that is swept.
pub const KNOBS: &[Knob] = &[
    train("steps", &[Times(0.5), Times(0.25), Times(2.0)]),
    train("max_triangles", &[Times(0.5), Times(0.25), Times(2.0)]),
    train("max_size", &[Times(0.5), Times(0.25)]),
    train("warmup.half_until", &[Is("12000"), Is("0"), Is("30000")]),
    train("warmup.quarter_until", &[Is("0"), Is("18000")]),
    train("sh_degree", &[Is("1"), Is("3")]),
    train("draw.sort_per_pixel", &[Is("true")]),
    train("loss.dssim", &[Is("0"), Is("0.2")]),
    train("rates.sparse", &[Is("false")]),
    train("refine.sample_by", &[Is("error"), Is("uniform")]),
    train("refine.every", &[Is("1000"), Is("250")]),
    train("refine.growth", &[Is("0.15"), Is("0.6")]),
    train("refine.prune_weight", &[Is("0.05"), Is("0.01")]),
    train("init.shell_subdivisions", &[Is("0"), Is("2")]),
    bake("preset", &[Is("fast"), Is("small")]),
    Knob {
        buys: "the choice of what is best on held-out photos",
        ..bake("refit", &[Is("flat"), Is("off"), Is("corner")])
    },
    bake("refit_passes", &[Is("2"), Is("4")]),
    bake("refit_flatness", &[Is("0"), Is("16")]),
    bake("keep_unseen", &[Is("true")]),
    bake("min_seen_px", &[Is("4"), Is("0"), Is("32")]),
    bake("max_triangles", &[Times(0.5), Times(0.75), Times(0.25)]),
    bake("max_error", &[Is("0.2"), Is("0.05"), Is("1")]),
    bake("backdrop", &[Is("off"), Is("sphere")]),
    Knob { buys: "levels of detail, files of their own", ..bake("lod", &[Is("0.5"), Is("0.5,0.25")]) },
    format("weld", &[Is("off"), Is("on")], "shared vertices"),
    format("compress", &[Is("true")], "a file that every viewer reads, without an extension"),
    format("target", &[Is("web"), Is("godot"), Is("unity"), Is("blender")], "what that engine reads"),
    format("bvh", &[Is("true")], "picking and visibility in the engine"),
    format(
        "chunk_triangles",
        &[Is("0"), Is("1024"), Is("4096")],
        "nodes that an engine skips when out of view",
    ),
    format("order", &[Is("none")], "near triangles near in the file, for the caches of the card"),
    soft("teacher", &[Is("off")]),
    soft("teacher_pictures", &[Is("16"), Is("8")]),
    soft("reshape", &[Is("off")]),
    soft("reshape_rounds", &[Is("8"), Is("32")]),
    soft("solid", &[Is("contour"), Is("area"), Is("none")]),
    soft("contour", &[Is("0.25"), Is("0.75")]),
    soft("min_opacity", &[Is("0.1"), Is("0"), Is("0.3")]),
    soft("max_sigma", &[Is("5"), Is("0"), Is("2")]),
    draw(CostInput::File, "ssaa", &[Is("1"), Is("2")]),
    draw(CostInput::SoftSoup, "sort_per_pixel", &[Is("true")]),
    draw(CostInput::SoftSoup, "cutoff", &[Is("0.03"), Is("0.0004"), Is("0.1")]),
    draw(CostInput::SoftSoup, "min_transmittance", &[Is("0.01"), Is("0"), Is("0.1")]),
];

/// Options whose gains do not add up, changed together; not with `--quick`.
pub const PAIRS: &[Pair] = &[
    pair_of_training(("steps", Times(0.5)), ("max_triangles", Times(0.5))),
    pair_of_training(("steps", Times(2.0)), ("max_triangles", Times(0.5))),
    pair_of_training(("steps", Times(2.0)), ("max_size", Times(0.5))),
    pair_of_training(("warmup.quarter_until", Is("0")), ("warmup.half_until", Is("0"))),
    pair_of_bake(("max_triangles", Times(0.5)), ("enlarge", Is("false"))),
    pair_of_bake(("max_triangles", Times(0.5)), ("refit_passes", Is("4"))),
    pair_of_bake(("compress", Is("true")), ("target", Is("web"))),
    Pair {
        stage: CostStage::Draw,
        input: CostInput::SoftSoup,
        changes: [("cutoff", Is("0.03")), ("min_transmittance", Is("0.01"))],
    },
];

const fn pair_of_training(first: (&'static str, KnobValue), second: (&'static str, KnobValue)) -> Pair {
    Pair { stage: CostStage::Train, input: CostInput::Photos, changes: [first, second] }
}

const fn pair_of_bake(first: (&'static str, KnobValue), second: (&'static str, KnobValue)) -> Pair {
    Pair { stage: CostStage::Bake, input: CostInput::SolidSoup, changes: [first, second] }
}

impl CostStage {
    /// As in rows and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Bake => "bake",
            Self::Draw => "draw",
            Self::Chain => "chain",
        }
    }
}

impl CostInput {
    /// As in rows.
    pub fn name(self) -> &'static str {
        match self {
            Self::Photos => "photos",
            Self::SolidSoup => "solid-soup",
            Self::SoftSoup => "soft-soup",
            Self::File => "file",
        }
    }
}
