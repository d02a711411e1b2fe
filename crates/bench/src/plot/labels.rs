//! Where the labels of dots go: beside their dots, and over nothing.

/// Width and height of a letter of a label, px.
const LETTER: [i32; 2] = [7, 13];
/// Half the width that a dot and its rim take, px.
const DOT: i32 = 6;

/// A box of a picture, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rect {
    /// Upper left corner.
    pub(super) at: [i32; 2],
    pub(super) size: [i32; 2],
}

impl Rect {
    fn overlaps(&self, other: &Self) -> bool {
        (0..2).all(|k| self.at[k] < other.at[k] + other.size[k] && other.at[k] < self.at[k] + self.size[k])
    }

    fn contains(&self, other: &Self) -> bool {
        (0..2).all(|k| self.at[k] <= other.at[k] && other.at[k] + other.size[k] <= self.at[k] + self.size[k])
    }
}

/// The boxes of labels: each as near to its dot as it can be without covering a dot, another label or what lies outside
/// `area`; `None` for a label that fits nowhere near. `dots` are all dots, the labelled ones first.
pub(super) fn place(names: &[&str], dots: &[[i32; 2]], area: Rect) -> Vec<Option<Rect>> {
    let mut taken: Vec<Rect> =
        dots.iter().map(|d| Rect { at: [d[0] - DOT, d[1] - DOT], size: [2 * DOT, 2 * DOT] }).collect();
    let place_one = |(name, dot): (&&str, &[i32; 2])| {
        let size = [name.chars().count() as i32 * LETTER[0], LETTER[1]];
        let free = |rect: &Rect| area.contains(rect) && !taken.iter().any(|t| t.overlaps(rect));
        let found = offsets(size).map(|by| Rect { at: [dot[0] + by[0], dot[1] + by[1]], size }).find(free);
        taken.extend(found);
        found
    };
    names.iter().zip(dots).map(place_one).collect()
}

/// Places of a label relative to its dot, the nearest first.
fn offsets(size: [i32; 2]) -> impl Iterator<Item = [i32; 2]> {
    let half = -LETTER[1] / 2;
    let sides = [DOT + 1, -size[0] - DOT - 1, -size[0] / 2];
    (0..24).flat_map(move |step| {
        let rows = [half - step * LETTER[1] / 2, half + step * LETTER[1] / 2];
        rows.into_iter().flat_map(move |dy| sides.map(|dx| [dx, dy]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const AREA: Rect = Rect { at: [0, 0], size: [500, 400] };

    #[test]
    fn labels_cover_neither_dots_nor_each_other_nor_the_frame() {
        let dots: Vec<[i32; 2]> = (0..30).map(|i| [40 + 14 * i, 200 + (i * i * 37) % 60 - 30]).collect();
        let names: Vec<String> = (0..14).map(|i| format!("option.of.some={i}")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let placed: Vec<Rect> = place(&names, &dots, AREA).into_iter().map(|p| p.unwrap()).collect();
        for (i, label) in placed.iter().enumerate() {
            assert!(AREA.contains(label), "{label:?}");
            assert!(placed[..i].iter().all(|other| !other.overlaps(label)), "{label:?}");
            let over = dots.iter().find(|d| Rect { at: **d, size: [1, 1] }.overlaps(label));
            assert_eq!(over, None);
        }
    }

    #[test]
    fn a_lone_label_is_right_of_its_dot_and_left_of_it_at_the_edge() {
        let right = place(&["name"], &[[100, 100]], AREA)[0].unwrap();
        assert_eq!((right.at, right.size), ([107, 94], [28, 13]));
        assert!(place(&["name"], &[[490, 100]], AREA)[0].unwrap().at[0] < 480);
    }

    #[test]
    fn a_label_without_room_is_left_out() {
        let narrow = Rect { at: [0, 0], size: [30, 400] };
        assert_eq!(place(&["a long name"], &[[10, 10]], narrow), [None]);
    }
}
