//! Which files of a crate import which, and the circles among them.
//!
//! The sources are split into tokens; nothing is expanded and no type is looked at. A file imports another if it names
//! something that the other defines: in a `use`, or by a path such as `crate::store::Chunk` or `plan::new`. A name that a module only
//! re-exports counts as the file that defines it. `mod x;` is no import, and code under `#[cfg(test)]` is left out: tests stand above
//! what they test.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use proc_macro2::{Delimiter, TokenStream, TokenTree};

/// How many re-exports a name is followed through. Rust allows longer chains, but nobody writes them.
const MOST_STEPS: u32 = 12;

type Names = Vec<String>;

/// Words that a name follows which the module defines.
const DEFINING: [&str; 9] = ["struct", "enum", "union", "fn", "trait", "type", "const", "static", "macro_rules"];

/// A module, in a file of its own or inside braces.
struct Module {
    file: PathBuf,
    parent: Option<usize>,
    children: BTreeMap<String, usize>,
    /// The names of its types, functions, constants and macros.
    items: BTreeSet<String>,
    /// What `use` brings in: the name in this module, and the path that it stands for.
    uses: BTreeMap<String, Names>,
    /// The paths before `::*`.
    globs: Vec<Names>,
    /// All paths that this module names, those of `use` included.
    paths: Vec<Names>,
}

/// The imports of one crate: for each file the files that it imports, with one of the names that it imports. Files are relative
/// to the folder of the crate's root file.
pub struct Imports(BTreeMap<String, BTreeMap<String, String>>);

impl Imports {
    /// Reads a crate from its root file, `lib.rs` or `main.rs`.
    pub fn of(root: &Path) -> Self {
        let mut sources = Sources { modules: Vec::new() };
        sources.read_file(root.to_owned(), None);
        let folder = root.parent().unwrap_or(root);
        let short = |module: &Module| {
            let relative = module.file.strip_prefix(folder).ok().and_then(Path::to_str);
            relative.expect("a source file below the root's folder").to_owned()
        };
        let mut arrows: BTreeMap<String, BTreeMap<String, String>> = BTreeMap::new();
        for (index, module) in sources.modules.iter().enumerate() {
            let targets = arrows.entry(short(module)).or_default();
            for path in &module.paths {
                if let Some((target, _)) = sources.find(index, path, 0)
                    && sources.modules[target].file != module.file
                {
                    targets.entry(short(&sources.modules[target])).or_insert_with(|| path.join("::"));
                }
            }
        }
        Self(arrows)
    }

    /// The imports of folders, each of which has the files that `folder_of` says. Files in no folder are left out.
    pub fn of_folders(&self, folder_of: impl Fn(&str) -> Option<String>) -> Self {
        let mut arrows: BTreeMap<String, BTreeMap<String, String>> = BTreeMap::new();
        for (from, targets) in &self.0 {
            let Some(folder) = folder_of(from) else { continue };
            for (to, name) in targets {
                let other = folder_of(to).filter(|other| *other != folder);
                let Some(other) = other else { continue };
                let imports = arrows.entry(folder.clone()).or_default();
                imports.entry(other).or_insert_with(|| format!("{name} ({from} of {to})"));
            }
        }
        Self(arrows)
    }

    /// Groups of files that all import one another, directly or through others, if the arrows `without` (from, to) are left
    /// out. Each is sorted and has two files or more.
    pub fn circles(&self, without: &[(&str, &str)]) -> Vec<Names> {
        let reached: BTreeMap<&str, BTreeSet<&str>> =
            self.0.keys().map(|file| (file.as_str(), self.reached_from(file, without))).collect();
        let circles: BTreeSet<Names> = reached
            .iter()
            .map(|(file, others)| {
                let back = |other: &&&str| reached.get(**other).is_some_and(|there| there.contains(file));
                others.iter().filter(back).map(|other| (*other).to_owned()).collect()
            })
            .collect();
        circles.into_iter().filter(|circle| circle.len() > 1).collect()
    }

    /// All files that can be reached from one along the arrows; the file itself only if there is a way back to it.
    fn reached_from(&self, from: &str, without: &[(&str, &str)]) -> BTreeSet<&str> {
        let mut reached = BTreeSet::new();
        let mut waiting = vec![from];
        while let Some(file) = waiting.pop() {
            for target in self.0.get(file).into_iter().flat_map(BTreeMap::keys) {
                if !without.contains(&(file, target)) && reached.insert(target.as_str()) {
                    waiting.push(target);
                }
            }
        }
        reached
    }

    /// Whether a file imports another.
    pub fn has(&self, (from, to): (&str, &str)) -> bool {
        self.0.get(from).is_some_and(|targets| targets.contains_key(to))
    }

    /// A line for each import between two files of a circle, with one of the names that make it.
    pub fn within(&self, circle: &[String]) -> String {
        let lines = self.0.iter().filter(|(from, _)| circle.contains(from)).flat_map(|(from, targets)| {
            let inside = targets.iter().filter(|(to, _)| circle.contains(to));
            inside.map(move |(to, name)| format!("  {from} imports {name} of {to}\n"))
        });
        lines.collect()
    }
}

/// The modules of one crate, the root first.
struct Sources {
    modules: Vec<Module>,
}

impl Sources {
    // ---- names ----

    /// The module that defines what `path` names in `module`, and how many names of the path are left for what is inside
    /// it (0: the path is this module itself). `None` for what is of another crate, or defined right there.
    fn find(&self, module: usize, path: &[String], steps: u32) -> Option<(usize, usize)> {
        if steps > MOST_STEPS {
            return None;
        }
        let mut names = path.iter().map(String::as_str).peekable();
        let mut at = match *names.peek()? {
            "crate" => {
                names.next();
                0
            }
            "self" | "super" => {
                let mut at = module;
                while let Some(name) = names.next_if(|name| matches!(*name, "self" | "super")) {
                    at = if name == "super" { self.modules[at].parent? } else { at };
                }
                at
            }
            first => {
                let is_itself = self.modules[module].uses.get(first).is_some_and(|stands_for| stands_for == path);
                // A name that stands for itself is another crate's: `use cloud::Chunk;`.
                if is_itself || !self.knows(module, first, steps) {
                    return None;
                }
                module
            }
        };
        while let Some(name) = names.next() {
            if let Some(child) = self.modules[at].children.get(name) {
                at = *child;
            } else if let Some(stands_for) = self.modules[at].uses.get(name) {
                let whole: Names = stands_for.iter().cloned().chain(names.map(str::to_owned)).collect();
                return self.find(at, &whole, steps + 1);
            } else if let Some(other) = self.through_globs(at, name, steps) {
                let rest: Names = std::iter::once(name).chain(names).map(str::to_owned).collect();
                let rest = [vec!["self".to_owned()], rest].concat();
                return self.find(other, &rest, steps + 1);
            } else {
                return Some((at, 1 + names.count()));
            }
        }
        Some((at, 0))
    }

    /// Whether a path of `module` may begin with `name`: what the module itself defines need not be looked for.
    fn knows(&self, module: usize, name: &str, steps: u32) -> bool {
        let own = &self.modules[module];
        own.children.contains_key(name)
            || own.uses.contains_key(name)
            || self.through_globs(module, name, steps).is_some()
    }

    /// The module that `name` comes from by a `use ...::*` of `module`.
    fn through_globs(&self, module: usize, name: &str, steps: u32) -> Option<usize> {
        let own = &self.modules[module];
        let is_here = |first: &str| {
            matches!(first, "crate" | "self" | "super")
                || own.children.contains_key(first)
                || own.uses.contains_key(first)
        };
        own.globs.iter().filter(|glob| is_here(&glob[0])).find_map(|glob| {
            let (other, left) = self.find(module, glob, steps + 1)?;
            let there = &self.modules[other];
            let is_there =
                there.children.contains_key(name) || there.uses.contains_key(name) || there.items.contains(name);
            (left == 0 && other != module && is_there).then_some(other)
        })
    }

    // ---- reading ----

    fn read_file(&mut self, file: PathBuf, parent: Option<usize>) -> usize {
        let text = std::fs::read_to_string(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        let tokens: TokenStream = text.parse().unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        let module = self.add(file, parent);
        self.read(module, tokens);
        module
    }

    fn add(&mut self, file: PathBuf, parent: Option<usize>) -> usize {
        let (children, items, uses, globs, paths) = Default::default();
        self.modules.push(Module { file, parent, children, items, uses, globs, paths });
        self.modules.len() - 1
    }

    fn read(&mut self, module: usize, tokens: TokenStream) {
        let tokens: Vec<TokenTree> = tokens.into_iter().collect();
        let mut at = 0;
        while at < tokens.len() {
            if is_test_attribute(&tokens[at..]) {
                at = after_item(&tokens, at + 2);
                continue;
            }
            let name = word(&tokens[at]);
            if name.as_deref() == Some("mod")
                && let Some(child) = tokens.get(at + 1).and_then(word)
            {
                let read = match tokens.get(at + 2) {
                    Some(TokenTree::Group(body)) if body.delimiter() == Delimiter::Brace => {
                        let inner = self.add(self.modules[module].file.clone(), Some(module));
                        self.read(inner, body.stream());
                        inner
                    }
                    _ => self.read_file(file_of(&self.modules[module].file, &child), Some(module)),
                };
                self.modules[module].children.insert(child, read);
                at += 3;
            } else if name.as_deref() == Some("use") {
                let end = (at..tokens.len()).find(|index| is_mark(&tokens[*index], ';')).unwrap_or(tokens.len());
                self.read_use(module, &[], &tokens[at + 1..end]);
                at = end;
            } else if let Some(name) = name {
                if DEFINING.contains(&name.as_str()) {
                    self.modules[module].items.extend(tokens.get(at + 1).and_then(word));
                }
                let (path, next) = path_from(&tokens, at);
                if path.len() > 1 {
                    self.modules[module].paths.push(path);
                }
                at = next;
            } else {
                if let TokenTree::Group(group) = &tokens[at] {
                    self.read(module, group.stream());
                }
                at += 1;
            }
        }
    }

    /// Reads what stands between `use` and `;`, or one of the trees inside its braces.
    fn read_use(&mut self, module: usize, before: &[String], tree: &[TokenTree]) {
        if tree.is_empty() {
            // Behind the last comma.
            return;
        }
        let mut path = before.to_vec();
        let mut alias = None;
        for (index, token) in tree.iter().enumerate() {
            match token {
                TokenTree::Group(group) => {
                    let inside: Vec<TokenTree> = group.stream().into_iter().collect();
                    return inside
                        .split(|token| is_mark(token, ','))
                        .for_each(|part| self.read_use(module, &path, part));
                }
                token if is_mark(token, '*') => {
                    self.modules[module].paths.push(path.clone());
                    return self.modules[module].globs.push(path);
                }
                token => match word(token) {
                    Some(name) if name == "as" => {
                        alias = tree.get(index + 1).and_then(word);
                        break;
                    }
                    Some(name) if name == "self" && !path.is_empty() => {}
                    Some(name) => path.push(name),
                    None => {}
                },
            }
        }
        let own = &mut self.modules[module];
        if let Some(name) = alias.or_else(|| path.last().cloned()) {
            own.uses.insert(name, path.clone());
            own.paths.push(path);
        }
    }
}

/// The file of `mod name;` in a file.
fn file_of(parent: &Path, name: &str) -> PathBuf {
    let is_root = ["lib.rs", "main.rs", "mod.rs"].iter().any(|root| parent.ends_with(root));
    let folder = if is_root { parent.with_file_name("") } else { parent.with_extension("") };
    let alone = folder.join(format!("{name}.rs"));
    if alone.exists() { alone } else { folder.join(name).join("mod.rs") }
}

fn word(token: &TokenTree) -> Option<String> {
    if let TokenTree::Ident(name) = token { Some(name.to_string()) } else { None }
}

fn is_mark(token: &TokenTree, mark: char) -> bool {
    matches!(token, TokenTree::Punct(punct) if punct.as_char() == mark)
}

/// Whether `#[cfg(test)]`, or a condition that contains `test`, comes next.
fn is_test_attribute(tokens: &[TokenTree]) -> bool {
    let [mark, TokenTree::Group(group), ..] = tokens else { return false };
    let text = group.stream().to_string();
    let words: Vec<&str> = text.split(|character: char| !character.is_alphanumeric() && character != '_').collect();
    is_mark(mark, '#') && words[0] == "cfg" && !words.contains(&"not") && words.contains(&"test")
}

/// Where the item ends that begins at `at`: behind its braces or its semicolon.
fn after_item(tokens: &[TokenTree], at: usize) -> usize {
    let is_end = |token: &TokenTree| match token {
        TokenTree::Group(group) => group.delimiter() == Delimiter::Brace,
        token => is_mark(token, ';'),
    };
    (at..tokens.len()).find(|index| is_end(&tokens[*index])).map_or(tokens.len(), |end| end + 1)
}

/// The path that begins at `at`, and where it ends.
fn path_from(tokens: &[TokenTree], at: usize) -> (Names, usize) {
    let mut path: Names = word(&tokens[at]).into_iter().collect();
    let mut next = at + 1;
    while let [first, second, name, ..] = &tokens[next..]
        && is_mark(first, ':')
        && is_mark(second, ':')
        && let Some(name) = word(name)
    {
        path.push(name);
        next += 3;
    }
    (path, next)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The circles of a crate of these files.
    fn circles(files: &[(&str, &str)]) -> Vec<Names> {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, text) in files {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
            std::fs::write(path, text).expect("a file");
        }
        Imports::of(&folder.path().join("lib.rs")).circles(&[])
    }

    #[test]
    fn a_way_back_is_a_circle_and_declaring_a_module_is_none() {
        let straight = [
            ("lib.rs", "mod a; mod b; mod c;"),
            ("a.rs", "use crate::b::B;"),
            ("b.rs", "use super::c; pub struct B(c::C);"),
            ("c.rs", "pub struct C;"),
        ];
        assert_eq!(circles(&straight), Vec::<Names>::new());
        let mut round = straight;
        for back in [
            "use crate::a::A;",
            "use super::{b::B, a::{self, A}};",
            "fn f(a: &crate::a::A) {}",
            "fn f() { matches!(x, super::a::A) }",
            "mod inner { use super::super::a::A; }",
            "use super::*; fn f() { a::run() }",
            "use crate::a as other; fn f() { other::run() }",
        ] {
            round[3].1 = back;
            assert_eq!(circles(&round), [["a.rs", "b.rs", "c.rs"]], "{back}");
        }
    }

    #[test]
    fn a_name_counts_as_the_file_that_defines_it() {
        // `a` takes B from the root, which only re-exports it, and nothing of the root's own.
        let mut files = [
            ("lib.rs", "mod a; mod deep; pub use a::A; pub use deep::B; pub fn own() {}"),
            ("a.rs", "use crate::B; pub struct A;"),
            ("deep/mod.rs", "mod b; pub use b::*;"),
            ("deep/b.rs", "pub struct B;"),
        ];
        assert_eq!(circles(&files), Vec::<Names>::new());
        files[3].1 = "use crate::A; pub struct B;";
        assert_eq!(circles(&files), [["a.rs", "deep/b.rs"]]);
        files[1].1 = "pub struct A; fn f() { crate::own() }";
        files[3].1 = "pub struct B;";
        assert_eq!(circles(&files), [["a.rs", "lib.rs"]]);
    }

    #[test]
    fn files_without_a_circle_may_put_their_folders_into_one() {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, text) in [
            ("lib.rs", "mod a; mod b;"),
            ("a/mod.rs", "pub mod high; pub mod low;"),
            ("a/high.rs", "use crate::b::B;"),
            ("a/low.rs", "pub struct Low;"),
            ("b/mod.rs", "use crate::a::low::Low; pub struct B(Low);"),
        ] {
            std::fs::create_dir_all(folder.path().join(name).parent().expect("a folder")).expect("a folder");
            std::fs::write(folder.path().join(name), text).expect("a file");
        }
        let imports = Imports::of(&folder.path().join("lib.rs"));
        assert_eq!(imports.circles(&[]), Vec::<Names>::new());
        let folders = imports.of_folders(|file| file.split_once('/').map(|(folder, _)| folder.to_owned()));
        assert_eq!(folders.circles(&[]), [["a", "b"]]);
    }

    #[test]
    fn tests_comments_texts_and_other_crates_are_no_imports() {
        for silent in [
            "#[cfg(test)] mod tests { use crate::a::A; }",
            "#[cfg(test)] mod tests;",
            "#[cfg(test)] use crate::a::{A, B};",
            "#[cfg(test)] fn f() { crate::a::run() }",
            "use super::{};",
            "// use crate::a::A;",
            "/// Like [`crate::a::A`].\nstruct B;",
            "const A: &str = \"crate::a::A\";",
            "use a::A;",
            "fn f() { own::a::run() } struct own;",
        ] {
            let files = [("lib.rs", "mod a; mod b;"), ("a.rs", "use crate::b::B;"), ("b.rs", silent)];
            assert_eq!(circles(&files), Vec::<Names>::new(), "{silent}");
        }
        let files = [
            ("lib.rs", "mod a; mod b;"),
            ("a.rs", "use crate::b::B;"),
            ("b.rs", "#[cfg(test)] use crate::c::{C, D}; #[cfg(not(test))] use crate::a::A;"),
        ];
        assert_eq!(circles(&files), [["a.rs", "b.rs"]]);
    }
}
