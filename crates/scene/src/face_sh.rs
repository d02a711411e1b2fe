//! View-dependent colours: real spherical harmonics of every face.

use crate::error::{Error, Result};
use crate::soup::{Soup, rgb_from_sh0, sh_count, sh0_from_rgb};

/// Largest degree of the harmonics.
pub const MAX_SH_DEGREE: u8 = 3;

/// Spherical harmonics of every face. The colour of a corner that is seen in the unit direction
/// `d`, from the camera to the corner, is its own colour, sRGB-encoded, plus Σ_j c_j Y_j(d),
/// bounded to 0 to 1. The Y are those of 3D Gaussian splatting, in its order.
#[derive(Debug, Clone, PartialEq)]
pub struct FaceSh {
    degree: u8,
    coefficients: Vec<[f32; 3]>,
}

/// Largest side of the picture that files store coefficients in, px: every WebGL 2 has textures of
/// this size.
pub const MAX_SH_PICTURE_SIDE: u32 = 2048;

impl FaceSh {
    /// The number of triangles of a file, by the texels that each takes.
    pub const fn max_faces(degree: u8) -> usize {
        let side = MAX_SH_PICTURE_SIDE as usize;
        side / sh_count(degree) * side
    }

    /// `coefficients` has (`degree` + 1)² entries per face. `[F * (degree + 1)²]`
    ///
    /// # Errors
    ///
    /// A degree that is not 1 to 3; an incomplete last face; numbers that are not finite.
    pub fn new(degree: u8, coefficients: Vec<[f32; 3]>) -> Result<Self> {
        if !(1..=MAX_SH_DEGREE).contains(&degree) {
            return Err(Error::invalid("degree of spherical harmonics", degree, "1, 2 or 3"));
        }
        let sh = Self { degree, coefficients };
        if !sh.coefficients.len().is_multiple_of(sh.width()) {
            let wants = format!("a multiple of {}", sh.width());
            return Err(Error::invalid("sh coefficient count", sh.coefficients.len(), wants));
        }
        if !sh.coefficients.as_flattened().iter().all(|value| value.is_finite()) {
            return Err(Error::invalid("sh coefficient", "not finite", "finite numbers"));
        }
        Ok(sh)
    }

    /// The harmonics of a soup. They add to its plain colours, whose channels lie between 0 and 1.
    ///
    /// # Errors
    ///
    /// A soup of degree 0; numbers that are not finite.
    pub fn of_soup(soup: &Soup) -> Result<Self> {
        let mut coefficients = soup.sh.clone();
        for constant in coefficients.iter_mut().step_by(soup.sh_count()) {
            *constant =
                constant.map(|value| value - sh0_from_rgb(rgb_from_sh0(value).clamp(0.0, 1.0)));
        }
        Self::new(soup.sh_degree, coefficients)
    }

    /// Faces without view dependence.
    fn zeros(degree: u8, faces: usize) -> Self {
        Self { degree, coefficients: vec![[0.0; 3]; faces * sh_count(degree)] }
    }

    /// Degree of the harmonics, 1 to 3.
    pub fn degree(&self) -> u8 {
        self.degree
    }

    /// Coefficients per face.
    pub fn width(&self) -> usize {
        sh_count(self.degree)
    }

    /// Number of faces.
    pub fn face_count(&self) -> usize {
        self.coefficients.len() / self.width()
    }

    /// The coefficients of a face, by degree. `[(degree + 1)²][channel]`
    #[inline]
    pub fn face(&self, face: usize) -> &[[f32; 3]] {
        &self.coefficients[face * self.width()..][..self.width()]
    }

    /// The coefficients of all faces. `[F * (degree + 1)²][channel]`
    pub fn coefficients(&self) -> &[[f32; 3]] {
        &self.coefficients
    }

    /// Changes the coefficients, one face at a time.
    pub fn map_faces(&mut self, change: impl Fn(&mut [[f32; 3]])) {
        let width = self.width();
        for face in self.coefficients.chunks_mut(width) {
            change(face);
        }
    }

    /// The coefficients of some faces, in this order.
    pub(crate) fn of_faces(&self, faces: &[u32]) -> Self {
        let of = |face: &u32| self.face(*face as usize).iter().copied();
        Self { degree: self.degree, coefficients: faces.iter().flat_map(of).collect() }
    }

    /// Appends the coefficients of `faces` more faces: zeros where `other` is `None`.
    fn append(&mut self, other: Option<&Self>, faces: usize) {
        let none = Self::zeros(self.degree, faces);
        let other = other.unwrap_or(&none);
        let degree = self.degree.max(other.degree);
        self.raise(degree);
        let mut other = other.clone();
        other.raise(degree);
        self.coefficients.append(&mut other.coefficients);
    }

    /// Adds coefficients of 0 up to `degree`.
    fn raise(&mut self, degree: u8) {
        if degree > self.degree {
            let mut raised = Self::zeros(degree, self.face_count());
            let width = raised.width();
            let before = self.coefficients.chunks(self.width());
            for (new, old) in raised.coefficients.chunks_mut(width).zip(before) {
                new[..old.len()].copy_from_slice(old);
            }
            *self = raised;
        }
    }

    /// The coefficients of `faces` faces. Ranges start at the face beside them, the other faces
    /// have zeros. `None` without ranges.
    pub fn of_ranges(ranges: Vec<(usize, FaceSh)>, faces: usize) -> Option<FaceSh> {
        let degree = ranges.iter().map(|(_, sh)| sh.degree).max()?;
        let mut all = Self::zeros(degree, faces);
        let width = all.width();
        for (first, mut sh) in ranges {
            sh.raise(degree);
            all.coefficients[first * width..][..sh.coefficients.len()]
                .copy_from_slice(&sh.coefficients);
        }
        Some(all)
    }

    /// The coefficients of `first`, a number of faces, followed by `second`; `None` if neither has
    /// any.
    pub(crate) fn joined(
        first: (Option<FaceSh>, usize),
        second: (Option<&FaceSh>, usize),
    ) -> Option<FaceSh> {
        let degree = second.0.map(|sh| sh.degree);
        let mut all = first.0.or_else(|| degree.map(|degree| Self::zeros(degree, first.1)))?;
        all.append(second.0, second.1);
        Some(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sh(degree: u8, faces: usize) -> FaceSh {
        let values = (0..faces * sh_count(degree)).map(|i| [i as f32, 0.5, -1.0]).collect();
        FaceSh::new(degree, values).unwrap()
    }

    #[test]
    fn join_different_degrees_pads_with_zeros() {
        let both = FaceSh::joined((Some(sh(1, 2)), 2), (Some(&sh(2, 1)), 1)).unwrap();
        assert_eq!((both.degree(), both.face_count()), (2, 3));
        assert_eq!(both.face(1)[..4], *sh(1, 2).face(1));
        assert_eq!(both.face(1)[4..], [[0.0; 3]; 5]);
        assert_eq!(both.face(2), sh(2, 1).face(0));
        let plain_first = FaceSh::joined((None, 2), (Some(&sh(1, 1)), 1)).unwrap();
        assert_eq!(plain_first.face(1), [[0.0; 3]; 4]);
        assert_eq!(plain_first.face(2), sh(1, 1).face(0));
        assert_eq!(FaceSh::joined((None, 2), (None, 1)), None);
    }

    #[test]
    fn select_faces_keeps_their_coefficients() {
        let three = sh(1, 3);
        let two = three.of_faces(&[2, 0]);
        assert_eq!(two.face(0), three.face(2));
        assert_eq!(two.face(1), three.face(0));
    }

    #[test]
    fn bad_input_is_refused() {
        for (degree, values) in
            [(0, vec![[0.0; 3]]), (4, vec![[0.0; 3]; 25]), (1, vec![[0.0; 3]; 5])]
        {
            assert!(FaceSh::new(degree, values).is_err());
        }
        assert!(FaceSh::new(1, vec![[f32::NAN; 3]; 4]).is_err());
    }
}
