//! Names of the collected photos: all distinct, also where upper and lower case are one.

use std::collections::HashSet;

/// The name that a photo is to have.
#[derive(Debug)]
pub(super) struct Wanted {
    /// Its path in the photo folder.
    pub(super) name: String,
    /// It becomes a PNG file.
    pub(super) to_png: bool,
}

impl Wanted {
    /// Its `rank`th choice, from 0.
    fn choice(&self, rank: usize) -> String {
        let name = &self.name;
        let dot = name.rfind('.').filter(|dot| !name[*dot..].contains('/')).unwrap_or(name.len());
        let (stem, ending) = name.split_at(dot);
        match (self.to_png, rank) {
            (false, 0) => name.clone(),
            (false, _) => format!("{stem}-{}{ending}", rank + 1),
            (true, 0) => format!("{stem}.png"),
            (true, 1) => format!("{name}.png"),
            (true, _) => format!("{name}-{rank}.png"),
        }
    }
}

/// The names of `photos`. Photos that keep their format choose first, and in order.
pub(super) fn distinct(photos: &[Wanted]) -> Vec<String> {
    let mut taken = HashSet::new();
    let mut names: Vec<Option<String>> = vec![None; photos.len()];
    for rank in 0.. {
        for to_png in [false, true] {
            let asks =
                |(photo, name): &(&Wanted, &mut Option<String>)| photo.to_png == to_png && name.is_none();
            for (photo, name) in photos.iter().zip(&mut names).filter(asks) {
                *name = Some(photo.choice(rank)).filter(|choice| taken.insert(choice.to_lowercase()));
            }
        }
        if names.iter().all(Option::is_some) {
            break;
        }
    }
    names.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photos_of_one_stem_or_of_names_that_differ_in_case_have_distinct_names() {
        let photos = ["A.png", "a.PNG", "a-2.PNG", "a.jpg", "a.webp", "a.tif", "b.c/d.tif"];
        let wanted: Vec<Wanted> = photos
            .iter()
            .map(|name| Wanted {
                name: (*name).to_owned(),
                to_png: name.ends_with("webp") || name.ends_with("tif"),
            })
            .collect();
        let names = distinct(&wanted);
        assert_eq!(names, ["A.png", "a-3.PNG", "a-2.PNG", "a.jpg", "a.webp.png", "a.tif.png", "b.c/d.png"]);
    }
}
