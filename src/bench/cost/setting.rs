//! A setting: the options that differ from the defaults, and the list of those to measure.

use super::base::Base;
use super::knobs::{CostInput, CostStage, KNOBS, KnobValue, PAIRS};
use crate::error::{Error, Result};

/// One way to run a stage.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Setting {
    pub(super) stage: CostStage,
    pub(super) input: CostInput,
    /// What is changed, by name and value; nothing in the default.
    pub(super) changes: Vec<(&'static str, String)>,
    /// The defaults of what is changed.
    pub(super) defaults: Vec<String>,
    /// The pictures must be those of the default.
    pub(super) same_scene: bool,
    /// What the dearer values are for, besides seconds, bytes and error.
    pub(super) buys: &'static str,
}

impl Setting {
    /// Nothing changed.
    pub(super) fn default_of(stage: CostStage, input: CostInput) -> Self {
        Self { stage, input, changes: Vec::new(), defaults: Vec::new(), same_scene: true, buys: "" }
    }

    pub(super) fn is_default(&self) -> bool {
        self.changes.is_empty()
    }

    /// The names of what is changed: "default", "steps", "steps+max_triangles".
    pub(super) fn knob(&self) -> String {
        match self.is_default() {
            true => "default".into(),
            false => self.changes.iter().map(|(name, _)| *name).collect::<Vec<_>>().join("+"),
        }
    }

    /// "steps=500", or "default".
    pub(super) fn label(&self) -> String {
        if self.is_default() { self.knob() } else { format!("{}={}", self.knob(), self.value()) }
    }

    /// Their values: "500", "500+3000".
    pub(super) fn value(&self) -> String {
        self.changes.iter().map(|(_, value)| value.as_str()).collect::<Vec<_>>().join("+")
    }
}

/// The settings of a stage: the default first, then every option that `only` names (all if it is empty), from the
/// default outwards, then pairs. With `quick` one value per option and no pairs.
pub(super) fn settings(
    stage: CostStage,
    input: CostInput,
    base: &Base,
    quick: bool,
    only: &[String],
) -> Vec<Setting> {
    let wanted = |name: &str| only.is_empty() || only.iter().any(|o| o == name);
    let setting = |changes: &[(&'static str, KnobValue)], same_scene, buys| {
        let changed = |(name, value): &(&'static str, KnobValue)| (*name, base.value_of(stage, name, *value));
        let default =
            |(name, _): &(&'static str, KnobValue)| base.default_of(stage, name).unwrap_or_default();
        Setting {
            stage,
            input,
            changes: changes.iter().map(changed).collect(),
            defaults: changes.iter().map(default).collect(),
            same_scene,
            buys,
        }
    };
    let mut settings = vec![Setting::default_of(stage, input)];
    for knob in KNOBS.iter().filter(|k| (k.stage, k.input) == (stage, input) && wanted(k.name)) {
        let values = if quick { &knob.values[..1] } else { knob.values };
        settings.extend(values.iter().map(|v| setting(&[(knob.name, *v)], knob.same_scene, knob.buys)));
    }
    let pairs = PAIRS.iter().filter(|p| (p.stage, p.input) == (stage, input) && !quick);
    let pairs = pairs.filter(|p| p.changes.iter().all(|(name, _)| wanted(name)));
    let same_scene = |name: &str| KNOBS.iter().any(|k| k.name == name && k.stage == stage && k.same_scene);
    settings.extend(pairs.map(|pair| {
        let same_scene = pair.changes.iter().all(|(name, _)| same_scene(name));
        setting(&pair.changes, same_scene, "")
    }));
    settings
}

/// Refuses names that are not swept in `stage`, or in any.
pub(super) fn check_names(only: &[String], stage: Option<CostStage>) -> Result<()> {
    let of_stage = |s: CostStage| stage.is_none_or(|wanted| wanted == s);
    let mut names: Vec<&str> = KNOBS.iter().filter(|k| of_stage(k.stage)).map(|k| k.name).collect();
    match only.iter().find(|name| !names.contains(&name.as_str())) {
        Some(wrong) => {
            names.sort_unstable();
            names.dedup();
            Err(Error::invalid("knob", wrong, format!("one of {}", names.join(", "))))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::cost::child;

    fn base() -> Base {
        Base { steps: 1000, max_triangles: 6000, long_side: 160, soup_triangles: 5000 }
    }

    const GROUPS: [(CostStage, CostInput); 5] = [
        (CostStage::Train, CostInput::Photos),
        (CostStage::Bake, CostInput::SolidSoup),
        (CostStage::Bake, CostInput::SoftSoup),
        (CostStage::Draw, CostInput::File),
        (CostStage::Draw, CostInput::SoftSoup),
    ];

    #[test]
    fn every_knob_is_an_option_with_a_default_that_is_not_among_its_values() {
        for knob in KNOBS {
            let default = base().default_of(knob.stage, knob.name);
            let default = default.unwrap_or_else(|| panic!("{} is no option", knob.name));
            assert!(!knob.values.is_empty(), "{}", knob.name);
            for value in knob.values {
                let value = base().value_of(knob.stage, knob.name, *value);
                assert_ne!(value, default, "{}", knob.name);
            }
        }
        for (name, _) in PAIRS.iter().flat_map(|p| p.changes.map(|c| (c.0, p.stage))) {
            assert!(KNOBS.iter().any(|k| k.name == name) || name == "enlarge", "{name}");
        }
    }

    #[test]
    fn commands_take_every_setting() {
        for (stage, input) in GROUPS {
            for setting in settings(stage, input, &base(), false, &[]) {
                let problem = child::refused(&setting);
                assert_eq!(problem, None, "{} = {}", setting.knob(), setting.value());
            }
        }
        let wrong = Setting {
            changes: vec![("refine.evry", "3".into())],
            ..Setting::default_of(CostStage::Train, CostInput::Photos)
        };
        assert!(child::refused(&wrong).is_some());
    }

    #[test]
    fn the_default_comes_first_and_quick_takes_one_value_per_option() {
        for (stage, input) in GROUPS {
            let (all, quick) =
                (settings(stage, input, &base(), false, &[]), settings(stage, input, &base(), true, &[]));
            assert!(all[0].is_default() && quick[0].is_default());
            assert_eq!(all.iter().filter(|s| s.is_default()).count(), 1);
            let knobs = KNOBS.iter().filter(|k| (k.stage, k.input) == (stage, input)).count();
            assert_eq!(quick.len(), 1 + knobs);
            assert!(all.len() > quick.len() || stage == CostStage::Draw);
        }
        let bakes = settings(CostStage::Bake, CostInput::SolidSoup, &base(), false, &[]);
        let same = |knob: &str| bakes.iter().find(|s| s.knob() == knob).map(|s| s.same_scene);
        assert_eq!([same("compress+target"), same("max_triangles+enlarge")], [Some(true), Some(false)]);
        let only = ["steps".to_owned()];
        let steps = settings(CostStage::Train, CostInput::Photos, &base(), false, &only);
        let names: Vec<(String, String)> = steps.iter().map(|s| (s.knob(), s.value())).collect();
        let wanted = [("default", ""), ("steps", "500"), ("steps", "250"), ("steps", "2000")];
        assert_eq!(names, wanted.map(|(k, v)| (k.to_owned(), v.to_owned())));
    }

    #[test]
    fn a_name_that_is_not_swept_is_refused_with_those_that_are() {
        check_names(&["refit".into(), "steps".into()], None).unwrap();
        let error = check_names(&["refit".into()], Some(CostStage::Train)).unwrap_err().to_string();
        assert!(error.contains("steps") && !error.contains("bvh"), "{error}");
        assert!(check_names(&["nonsense".into()], None).is_err());
    }
}
