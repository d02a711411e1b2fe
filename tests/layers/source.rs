//! What one Rust file names of other files: read token by token, so that comments, strings and test
//! modules do not count.

use std::collections::{BTreeMap, BTreeSet};

/// A path, segment by segment: `crate::math::color` is `["crate", "math", "color"]`.
pub(super) type Path = Vec<String>;

/// What one file says about modules.
#[derive(Debug, Default)]
pub(super) struct Source {
    /// Paths that it names, from the file's own module; those of `use` and those in expressions.
    pub(super) paths: Vec<Path>,
    /// Names that it re-exports, each with the path behind it; `*` is everything of that path.
    pub(super) exports: Vec<(String, Path)>,
    /// Items that it defines.
    pub(super) defines: BTreeSet<String>,
}

impl Source {
    /// Reads a file.
    pub(super) fn parse(text: &str) -> Self {
        let tokens = without_tests(&tokens(text));
        let mut reader = Reader { tokens: &tokens, ..Reader::default() };
        reader.declarations();
        reader.paths();
        reader.source
    }
}

/// Identifiers, `::` and single characters of punctuation. Comments, strings, characters and
/// lifetimes are left out.
fn tokens(text: &str) -> Vec<String> {
    let chars = text.chars().collect::<Vec<char>>();
    let mut tokens = Vec::new();
    let mut at = 0;
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    while let Some(&c) = chars.get(at) {
        let next = chars.get(at + 1).copied().unwrap_or(' ');
        if c == '/' && next == '/' {
            at += chars[at..].iter().position(|c| *c == '\n').unwrap_or(chars.len() - at);
        } else if c == '/' && next == '*' {
            at = after_block_comment(&chars, at);
        } else if c == '"' {
            at = after_string(&chars, at, 0);
        } else if c == '\'' {
            at = after_quote(&chars, at);
        } else if is_word(c) {
            let start = at;
            at += chars[at..].iter().position(|c| !is_word(*c)).unwrap_or(chars.len() - at);
            let word: String = chars[start..at].iter().collect();
            let hashes = chars[at..].iter().take_while(|c| **c == '#').count();
            match chars.get(at + hashes) {
                Some('"') if ["r", "br", "cr"].contains(&word.as_str()) => {
                    at = after_raw(&chars, at, hashes)
                }
                Some('"') if ["b", "c"].contains(&word.as_str()) && hashes == 0 => {
                    at = after_string(&chars, at, 0)
                }
                _ => tokens.push(word),
            }
        } else if c == ':' && next == ':' {
            tokens.push("::".to_owned());
            at += 2;
        } else {
            tokens.extend((!c.is_whitespace()).then(|| c.to_string()));
            at += 1;
        }
    }
    tokens
}

/// Block comments nest.
fn after_block_comment(chars: &[char], mut at: usize) -> usize {
    let mut depth = 0;
    while at + 1 < chars.len() {
        match [chars[at], chars[at + 1]] {
            ['/', '*'] => (depth, at) = (depth + 1, at + 2),
            ['*', '/'] => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
        if depth == 0 {
            return at;
        }
    }
    chars.len()
}

/// The place after a string whose opening quote is `skip` characters behind `at`.
fn after_string(chars: &[char], at: usize, skip: usize) -> usize {
    let mut at = at + skip + 1;
    while at < chars.len() && chars[at] != '"' {
        at += if chars[at] == '\\' { 2 } else { 1 };
    }
    at + 1
}

/// The place after a raw string with that number of `#`.
fn after_raw(chars: &[char], at: usize, hashes: usize) -> usize {
    let mut at = at + hashes + 1;
    while at < chars.len() {
        let closes =
            chars[at] == '"' && chars[at + 1..].iter().take_while(|c| **c == '#').count() >= hashes;
        at += 1;
        if closes {
            return at + hashes;
        }
    }
    at
}

/// The place after a character; after the quote alone where a lifetime begins.
fn after_quote(chars: &[char], at: usize) -> usize {
    match (chars.get(at + 1), chars.get(at + 2)) {
        (Some('\\'), _) => at + 4 + chars[at + 3..].iter().position(|c| *c == '\'').unwrap_or(0),
        (Some(_), Some('\'')) => at + 3,
        _ => at + 1,
    }
}

/// The tokens without `#[cfg(test)] mod … { … }`; what follows such a module stays.
fn without_tests(tokens: &[String]) -> Vec<String> {
    const MARK: [&str; 7] = ["#", "[", "cfg", "(", "test", ")", "]"];
    let mut kept = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        if tokens[at..].iter().take(MARK.len()).eq(&MARK) {
            let mut item = at + MARK.len();
            while tokens.get(item).is_some_and(|t| t == "#") {
                item = closing(tokens, item + 1) + 1;
            }
            let module = tokens.get(item).is_some_and(|t| t == "mod");
            if module && tokens.get(item + 2).is_some_and(|t| t == "{") {
                at = closing(tokens, item + 2) + 1;
                continue;
            }
        }
        kept.push(tokens[at].clone());
        at += 1;
    }
    kept
}

/// Where the bracket that opens at `at` closes.
fn closing(tokens: &[String], at: usize) -> usize {
    let mut depth = 0;
    for (i, token) in tokens.iter().enumerate().skip(at) {
        match token.as_str() {
            "(" | "[" | "{" => depth += 1,
            ")" | "]" | "}" => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return i;
        }
    }
    tokens.len() - 1
}

#[derive(Default)]
struct Reader<'a> {
    tokens: &'a [String],
    source: Source,
    /// Modules in files of their own that this file declares.
    children: BTreeSet<String>,
    /// What `use` brings into scope: name and path.
    names: BTreeMap<String, Path>,
    /// Identifiers outside `use`.
    words: BTreeSet<String>,
    /// Modules written out in this file that are open here, each with the place where it ends.
    inline: Vec<(String, usize)>,
}

impl Reader<'_> {
    fn token(&self, at: usize) -> &str {
        self.tokens.get(at).map_or("", String::as_str)
    }

    /// Items and child modules: they are in scope in the whole file, also above themselves.
    fn declarations(&mut self) {
        const ITEMS: [&str; 8] =
            ["struct", "enum", "fn", "const", "static", "type", "trait", "mod"];
        for at in 0..self.tokens.len() {
            if !ITEMS.contains(&self.token(at)) {
                continue;
            }
            let name = self.token(at + 1).to_owned();
            let is_child = self.token(at) == "mod" && self.token(at + 2) == ";";
            if is_child {
                self.children.insert(name)
            } else {
                self.source.defines.insert(name)
            };
        }
    }

    fn paths(&mut self) {
        let mut at = 0;
        while at < self.tokens.len() {
            self.inline.retain(|(_, end)| at < *end);
            match self.token(at) {
                "mod" if self.token(at + 2) == "{" => {
                    let end = closing(self.tokens, at + 2);
                    self.inline.push((self.token(at + 1).to_owned(), end));
                    at += 3;
                }
                "use" if self.token(at + 1) != "<" => at = self.import(at),
                _ => at = self.expression(at),
            }
        }
        // A re-export is an import too where the file itself works with it.
        let used = self.source.exports.iter().filter(|(name, _)| self.words.contains(name));
        let used: Vec<Path> = used.map(|(_, path)| path.clone()).collect();
        self.source.paths.extend(used);
    }

    /// Reads `use …;` and returns the place after it.
    fn import(&mut self, at: usize) -> usize {
        let exported = at > 0 && ["pub", ")"].contains(&self.token(at - 1));
        let mut leaves = Vec::new();
        let mut end = at + 1;
        self.tree(&mut end, Vec::new(), &mut leaves);
        for (name, path) in leaves {
            let Some(path) = self.anchored(path) else { continue };
            if exported && self.inline.is_empty() {
                self.source.exports.push((name, path));
            } else {
                self.names.insert(name, path.clone());
                self.source.paths.push(path);
            }
        }
        end + 1
    }

    /// The leaves of `a::{b, c::d as e}`: the names they get, and their paths.
    fn tree(&self, at: &mut usize, mut path: Path, leaves: &mut Vec<(String, Path)>) {
        loop {
            match self.token(*at) {
                "::" => *at += 1,
                "{" => {
                    let end = closing(self.tokens, *at);
                    *at += 1;
                    while *at < end {
                        self.tree(at, path.clone(), leaves);
                        *at += usize::from(self.token(*at) == ",");
                    }
                    *at = end + 1;
                    return;
                }
                "as" => {
                    leaves.push((self.token(*at + 1).to_owned(), path));
                    *at += 2;
                    return;
                }
                "," | ";" | "}" | "" => {
                    let name = path.last().cloned().unwrap_or_default();
                    leaves.push((name, path));
                    return;
                }
                "*" => {
                    leaves.push(("*".to_owned(), path.clone()));
                    *at += 1;
                    return;
                }
                // `a::{self}` is `a`.
                "self" if !path.is_empty() => *at += 1,
                word => {
                    path.push(word.to_owned());
                    *at += 1;
                }
            }
        }
    }

    /// Reads one token, or a whole path where one begins, and returns the place after it.
    fn expression(&mut self, at: usize) -> usize {
        let word = self.token(at).to_owned();
        if at == 0 || self.token(at - 1) != "mod" {
            self.words.insert(word.clone());
        }
        if self.token(at + 1) != "::" || (at > 0 && self.token(at - 1) == "::") {
            return at + 1;
        }
        let mut path = vec![word.clone()];
        let mut end = at + 1;
        let is_name = |word: &str| word.starts_with(|c: char| c.is_alphabetic() || c == '_');
        while self.token(end) == "::" && is_name(self.token(end + 1)) {
            path.push(self.token(end + 1).to_owned());
            end += 2;
        }
        if let Some(module) = self.names.get(&word) {
            let rest = path.split_off(1);
            self.source.paths.push([module.clone(), rest].concat());
        } else if let Some(path) = self.anchored(path) {
            self.source.paths.push(path);
        }
        end
    }

    /// The path from the file's own module or the crate; none when it leads elsewhere.
    fn anchored(&self, path: Path) -> Option<Path> {
        let first = path.first()?.as_str();
        let inline = || self.inline.iter().map(|(name, _)| name.clone());
        match first {
            "crate" => Some(path),
            "super" | "self" => {
                Some(std::iter::once("self".to_owned()).chain(inline()).chain(path).collect())
            }
            _ if self.children.contains(first) => Some([vec!["self".to_owned()], path].concat()),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paths(text: &str) -> Vec<String> {
        Source::parse(text).paths.iter().map(|path| path.join("::")).collect()
    }

    #[test]
    fn braces_aliases_and_globs_are_read() {
        let text = "use crate::{a::b, c::{self, D as E, f::*}}; use super::super::g; use std::fmt;";
        let wants =
            ["crate::a::b", "crate::c", "crate::c::D", "crate::c::f", "self::super::super::g"];
        assert_eq!(paths(text), wants);
    }

    #[test]
    fn expressions_are_read_through_the_names_in_scope() {
        let text = "mod child; use crate::a; fn f(x: super::T<'_>) { a::g::<u8>(); child::h(); E::V; '\\''; }";
        let wants = ["crate::a", "self::super::T", "crate::a::g", "self::child::h"];
        assert_eq!(paths(text), wants);
    }

    #[test]
    fn comments_strings_and_test_modules_do_not_count() {
        let text = r####"
            // crate::a
            /* crate::b /* nested */ crate::c */
            const S: &str = "crate::d \" crate::e"; const R: &str = r#"crate::f " crate::g"#;
            #[cfg(test)] #[allow(x)] mod tests { use crate::h; fn f() { "}"; '}'; } }
            fn after() { crate::i::j() }
        "####;
        assert_eq!(paths(text), ["crate::i::j"]);
    }

    #[test]
    fn re_exports_count_where_the_file_works_with_them() {
        let text = "mod a; pub mod g; pub use a::{B, C}; pub use g::g; pub(crate) use crate::d::*; fn f(b: B) {}";
        let source = Source::parse(text);
        let names: Vec<&str> = source.exports.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["B", "C", "g", "*"]);
        assert_eq!(paths(text), ["self::a::B"]);
        assert!(source.defines.contains("f") && !source.defines.contains("a"));
    }

    #[test]
    fn modules_written_out_in_a_file_are_its_own() {
        assert_eq!(paths("mod m { use super::super::x; }"), ["self::m::super::super::x"]);
    }
}
